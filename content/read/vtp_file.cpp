#include "content/read/vtp_file.hpp"

#include <algorithm>
#include <cmath>
#include <pugixml.hpp>

#include "content/read/polygon_list.hpp"
#include "content/text/number_text.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

using pugi::xml_node;

struct VtpState {
    const std::filesystem::path& path;
    LoadedMesh loaded{};
    PolygonList list{};
    std::vector<double> material{};  // per polygon

    [[noreturn]] void fail(const std::string& reason) const { throw InputError(path.string() + ": " + reason); }
    // The numbers of an array; none for no array.
    std::vector<double> numbers(const xml_node& array) const {
        const std::string name = "array '" + std::string(array.attribute("Name").value()) + "'";
        const std::string_view format = array.attribute("format").as_string("ascii");
        if (format != "ascii") fail(name + " is stored as " + std::string(format) + "; only ascii is read");
        const std::string_view text = array.child_value();
        std::vector<double> numbers;
        const auto skip = [&](const char* at) {
            return std::find_if(at, text.end(), [](char c) { return static_cast<unsigned char>(c) > ' '; });
        };
        for (const char* at = skip(text.begin()); at != text.end(); at = skip(at)) {
            numbers.emplace_back();
            at = parse_number(at, text.end(), numbers.back());
            if (!at || !std::isfinite(numbers.back())) fail(name + ": number " + std::to_string(numbers.size() - 1) + " is not finite");
        }
        return numbers;
    }
};

xml_node array_named(const xml_node& data, const char* name) { return data.find_child_by_attribute("DataArray", "Name", name); }

uint32_t row_of(const VtpState& s, double value, size_t below, const char* what) {
    if (value >= 0 && value < static_cast<double>(below) && value == std::floor(value)) return static_cast<uint32_t>(value);
    s.fail(std::string(what) + " is not a whole number below " + std::to_string(below));
}

// Appends the cells of a piece whose points begin at `base`; returns their number.
size_t add_cells(VtpState& s, const xml_node& cells, uint32_t base, size_t points, bool strips) {
    const std::vector<double> ends = s.numbers(array_named(cells, "offsets")), corners = s.numbers(array_named(cells, "connectivity"));
    if (corners.size() + s.list.corner.size() >= kNone / 3) s.fail("more corners than 32 bits can number");
    std::vector<uint32_t> cell;
    size_t first = 0;
    for (const double value : ends) {
        const size_t end = row_of(s, value, corners.size() + 1, "an offset");
        cell.clear();
        for (; first < end; ++first) cell.push_back(base + row_of(s, corners[first], points, "a corner"));
        if (strips) {
            add_strip(cell, s.list);
        } else {
            s.list.corner.insert(s.list.corner.end(), cell.begin(), cell.end());
            s.list.end.push_back(static_cast<uint32_t>(s.list.corner.size()));
        }
    }
    return ends.size();
}

std::vector<Vec2> texture_pairs(const std::vector<double>& numbers) {
    std::vector<Vec2> uv;
    for (size_t i = 0; i + 1 < numbers.size(); i += 2) uv.push_back(texture_coordinate(numbers[i], numbers[i + 1]));
    return uv;
}

void add_piece(VtpState& s, const xml_node& piece) {
    std::vector<Vec3d>& position = s.loaded.mesh.position;
    const std::vector<double> points = s.numbers(piece.child("Points").child("DataArray"));
    const size_t base = position.size(), count = points.size() / 3;
    if (points.size() != 3 * piece.attribute("NumberOfPoints").as_ullong() || base + count >= kNone) {
        s.fail("a piece has " + std::to_string(points.size()) + " coordinates for " + piece.attribute("NumberOfPoints").value() +
               " points");
    }
    for (size_t v = 0; v < count; ++v) position.emplace_back(points[3 * v], points[3 * v + 1], points[3 * v + 2]);
    const size_t polygons = add_cells(s, piece.child("Polys"), static_cast<uint32_t>(base), count, false);
    if (polygons != piece.attribute("NumberOfPolys").as_ullong()) {
        s.fail("a piece has " + std::to_string(polygons) + " polygons where it names " + piece.attribute("NumberOfPolys").value());
    }
    add_cells(s, piece.child("Strips"), static_cast<uint32_t>(base), count, true);
    const xml_node of_points = piece.child("PointData"), of_cells = piece.child("CellData");
    const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
    append(s.list.point_uv, texture_pairs(s.numbers(array_named(of_points, of_points.attribute("TCoords").value()))));
    append(s.list.corner_uv, texture_pairs(s.numbers(array_named(of_cells, "texture_coordinates"))));
    append(s.material, s.numbers(array_named(of_cells, "material")));
}

}  // namespace

bool looks_like_vtp(std::string_view bytes) {
    const size_t first = bytes.find_first_not_of(" \t\r\n");
    return first != std::string_view::npos && bytes[first] == '<' && bytes.substr(0, 4096).find("<VTKFile") != std::string_view::npos;
}

LoadedMesh read_vtp(std::string_view bytes, const std::filesystem::path& path) {
    VtpState s{path};
    pugi::xml_document xml;
    const pugi::xml_parse_result result = xml.load_buffer(bytes.data(), bytes.size(), pugi::parse_escapes | pugi::parse_cdata);
    if (!result) s.fail("not well-formed XML at byte " + std::to_string(result.offset) + ": " + result.description());
    const xml_node file = xml.child("VTKFile");
    const std::string kind = file.attribute("type").value();
    if (kind != "PolyData") s.fail("VTKFile of type '" + kind + "' is not read, only PolyData");
    s.loaded.format = "VTP";
    for (const xml_node& piece : file.child("PolyData").children("Piece")) add_piece(s, piece);
    // values that do not belong to every point or corner of all pieces are left out
    if (s.list.point_uv.size() != s.loaded.mesh.position.size()) s.list.point_uv.clear();
    if (s.list.corner_uv.size() != s.list.corner.size()) s.list.corner_uv.clear();
    cut_polygons(s.list, s.loaded, path);
    Mesh& mesh = s.loaded.mesh;
    uint32_t materials = 1;
    if (s.material.size() == mesh.triangle.size()) {
        for (const double value : s.material) {
            mesh.triangle_material.push_back(static_cast<uint16_t>(row_of(s, value, 65535, "a material")));
            materials = std::max(materials, mesh.triangle_material.back() + 1u);
        }
    }
    mesh.material.resize(materials);
    return std::move(s.loaded);
}

}  // namespace trocar
