#include "content/write/save_tets.hpp"

#include <charconv>

#include "engine/base/error.hpp"
#include "engine/files/whole_file.hpp"
namespace trocar {
namespace {

template <typename Number>
void put_number(std::string& out, Number value) {
    char text[32];
    out.append(text, std::to_chars(text, text + sizeof text, value).ptr);
}

// A block of the appended section: its size in 64 bits, then its bytes.
template <typename Value>
void put_block(std::string& data, const std::vector<Value>& values) {
    const uint64_t bytes = values.size() * sizeof(Value);
    data.append(reinterpret_cast<const char*>(&bytes), sizeof bytes);
    data.append(reinterpret_cast<const char*>(values.data()), bytes);
}

std::string array_element(const char* type, const char* name, const char* components, size_t offset) {
    return std::string("        <DataArray type=\"") + type + "\" Name=\"" + name + "\"" + components + " format=\"appended\" offset=\"" +
           std::to_string(offset) + "\"/>\n";
}

}  // namespace

std::string encode_vtu(const TetMesh& mesh) {
    std::vector<double> points;
    for (const Vec3d& p : mesh.position) points.insert(points.end(), {p.x(), p.y(), p.z()});
    std::vector<int64_t> corners, ends;
    for (const auto& t : mesh.tetrahedron) {
        corners.insert(corners.end(), t.begin(), t.end());
        ends.push_back(static_cast<int64_t>(corners.size()));
    }
    constexpr uint8_t kVtkTetra = 10;
    std::string data;
    put_block(data, points);
    const size_t at_corners = data.size();
    put_block(data, corners);
    const size_t at_ends = data.size();
    put_block(data, ends);
    const size_t at_types = data.size();
    put_block(data, std::vector<uint8_t>(mesh.tetrahedron.size(), kVtkTetra));
    std::string xml =
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" "
        "header_type=\"UInt64\">\n  <UnstructuredGrid>\n    <Piece NumberOfPoints=\"" +
        std::to_string(mesh.position.size()) + "\" NumberOfCells=\"" + std::to_string(mesh.tetrahedron.size()) + "\">\n";
    xml += "      <Points>\n" + array_element("Float64", "Points", " NumberOfComponents=\"3\"", 0) + "      </Points>\n";
    xml += "      <Cells>\n" + array_element("Int64", "connectivity", "", at_corners) + array_element("Int64", "offsets", "", at_ends) +
           array_element("UInt8", "types", "", at_types) + "      </Cells>\n";
    xml += "    </Piece>\n  </UnstructuredGrid>\n  <AppendedData encoding=\"raw\">\n_";
    return xml + data + "\n  </AppendedData>\n</VTKFile>\n";
}

std::string encode_msh(const TetMesh& mesh) {
    std::string out = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n";
    put_number(out, mesh.position.size());
    out += "\n";
    for (size_t v = 0; v < mesh.position.size(); ++v) {
        put_number(out, v + 1);
        for (int c = 0; c < 3; ++c) {
            out += " ";
            put_number(out, mesh.position[v][c]);
        }
        out += "\n";
    }
    out += "$EndNodes\n$Elements\n";
    put_number(out, mesh.tetrahedron.size());
    out += "\n";
    for (size_t t = 0; t < mesh.tetrahedron.size(); ++t) {
        put_number(out, t + 1);
        out += " 4 2 1 1";  // tetrahedron with four nodes, two tags: physical group 1, elementary entity 1
        for (const uint32_t v : mesh.tetrahedron[t]) {
            out += " ";
            put_number(out, v + 1);
        }
        out += "\n";
    }
    return out + "$EndElements\n";
}

void save_tets(const TetMesh& mesh, const std::filesystem::path& path) {
    if (path.extension() == ".vtu") return write_whole_file(path, std::string_view(encode_vtu(mesh)));
    if (path.extension() == ".msh") return write_whole_file(path, std::string_view(encode_msh(mesh)));
    throw InputError(path.string() + ": cannot write: the name must end in .vtu or .msh");
}

}  // namespace trocar
