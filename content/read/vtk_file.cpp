#include "content/read/vtk_file.hpp"

#include <cmath>

#include "content/read/polygon_list.hpp"
#include "content/text/byte_order.hpp"
#include "content/text/words.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

struct NamedScalar {
    std::string_view name;
    Scalar type;
    bool number = true;
};

constexpr NamedScalar kScalars[] = {{"char", Scalar::kInt8},
                                    {"signed_char", Scalar::kInt8},
                                    {"unsigned_char", Scalar::kUint8},
                                    {"short", Scalar::kInt16},
                                    {"unsigned_short", Scalar::kUint16},
                                    {"int", Scalar::kInt32},
                                    {"unsigned_int", Scalar::kUint32},
                                    {"long", Scalar::kInt64},
                                    {"unsigned_long", Scalar::kUint64},
                                    {"vtkidtype", Scalar::kInt32},
                                    {"vtktypeint8", Scalar::kInt8},
                                    {"vtktypeuint8", Scalar::kUint8},
                                    {"vtktypeint16", Scalar::kInt16},
                                    {"vtktypeuint16", Scalar::kUint16},
                                    {"vtktypeint32", Scalar::kInt32},
                                    {"vtktypeuint32", Scalar::kUint32},
                                    {"vtktypeint64", Scalar::kInt64},
                                    {"vtktypeuint64", Scalar::kUint64},
                                    {"vtktypefloat32", Scalar::kFloat},
                                    {"vtktypefloat64", Scalar::kDouble},
                                    {"float", Scalar::kFloat},
                                    {"double", Scalar::kDouble},
                                    {"bit", Scalar::kUint8, false},
                                    {"string", Scalar::kUint8, false}};

struct VtkState {
    Words words;
    bool binary = false;
    LoadedMesh loaded;
    PolygonList polygons;

    uint64_t left() const { return static_cast<uint64_t>(words.end - words.at); }
};

NamedScalar read_type(VtkState& s) {
    const std::string_view word = s.words.next();
    for (const NamedScalar& scalar : kScalars) {
        if (same_word(word, scalar.name)) return scalar;
    }
    s.words.fail("unknown type " + shown(word) + " of data");
}

// Reads `count` numbers and passes each to `take`. The caller has checked that the file can hold them.
template <typename Take>
void read_numbers(VtkState& s, uint64_t count, const NamedScalar& scalar, Take take) {
    if (!s.binary) {
        for (uint64_t k = 0; k < count; ++k) take(s.words.number(true));
        return;
    }
    s.words.rest_of_line();
    const size_t size = scalar_bytes(scalar.type);
    if (count > s.left() / size) s.words.fail("binary data is cut short");
    for (uint64_t k = 0; k < count; ++k, s.words.at += size) take(scalar_from_bytes(s.words.at, scalar.type, true));
}

// Each number needs at least a digit and a blank, or one byte in binary.
uint64_t read_count(VtkState& s, const char* what) { return s.words.count(what, s.binary ? s.left() : s.left() / 2 + 1); }

void read_points(VtkState& s) {
    const uint64_t count = read_count(s, "a number of points");
    const NamedScalar scalar = read_type(s);
    if (!scalar.number) s.words.fail("points that are no numbers");
    if (3 * count > (s.binary ? s.left() / scalar_bytes(scalar.type) : s.left() / 2 + 1) || count >= kNone) {
        s.words.fail("the file is too short for " + std::to_string(count) + " points");
    }
    std::vector<Vec3d>& position = s.loaded.mesh.position;
    if (!position.empty()) s.words.fail("a second list of points");
    position.resize(count);
    uint64_t k = 0;
    read_numbers(s, 3 * count, scalar, [&](double value) {
        if (!std::isfinite(value)) {
            s.words.fail("point " + std::to_string(k / 3) + " has a coordinate that is not a finite number");
        }
        position[k / 3][static_cast<int>(k % 3)] = value;
        ++k;
    });
}

void add_cell(VtkState& s, std::span<const uint32_t> corner, bool strips) {
    if (s.polygons.corner.size() + 3 * corner.size() >= kNone) s.words.fail("more corners than 32 bits can number");
    if (strips) return add_strip(corner, s.polygons);
    s.polygons.corner.insert(s.polygons.corner.end(), corner.begin(), corner.end());
    s.polygons.end.push_back(static_cast<uint32_t>(s.polygons.corner.size()));
}

// Integers of a list; invalid point indices become kNone, which cut_polygons rejects with the polygon's name.
std::vector<uint32_t> read_rows(VtkState& s, uint64_t count, const NamedScalar& scalar) {
    std::vector<uint32_t> row;
    if (!scalar.number) s.words.fail("a list of corners that are no numbers");
    if (count > (s.binary ? s.left() / scalar_bytes(scalar.type) : s.left() / 2 + 1)) {
        s.words.fail("the file is too short for a list of " + std::to_string(count) + " numbers");
    }
    row.reserve(count);
    read_numbers(s, count, scalar, [&](double value) {
        const bool good = value >= 0 && value < kNone && value == std::floor(value);
        row.push_back(good ? static_cast<uint32_t>(value) : kNone);
    });
    return row;
}

// Since version 5.1: the offset of each cell into the corners, then the corners.
void read_cells_by_offset(VtkState& s, uint64_t offsets, uint64_t corners, bool wanted, bool strips) {
    s.words.next();
    const std::vector<uint32_t> first = read_rows(s, offsets, read_type(s));
    const std::string_view word = s.words.next();
    if (!same_word(word, "connectivity")) s.words.fail("expected CONNECTIVITY, found " + shown(word));
    const std::vector<uint32_t> corner = read_rows(s, corners, read_type(s));
    for (size_t k = 0; wanted && k + 1 < first.size(); ++k) {
        if (first[k] > first[k + 1] || first[k + 1] > corner.size()) {
            s.words.fail("cell " + std::to_string(k) + " begins or ends outside its list of corners");
        }
        add_cell(s, std::span(corner).subspan(first[k], first[k + 1] - first[k]), strips);
    }
}

// POLYGONS, TRIANGLE_STRIPS, LINES or VERTICES, whose keyword was just read.
void read_cells(VtkState& s, bool wanted, bool strips) {
    const uint64_t cells = read_count(s, "a number of cells");
    const uint64_t size = read_count(s, "a size of a list");
    if (same_word(s.words.peek(), "offsets")) return read_cells_by_offset(s, cells, size, wanted, strips);
    const std::vector<uint32_t> row = read_rows(s, size, {"int", Scalar::kInt32});
    size_t at = 0;
    for (uint64_t k = 0; k < cells; ++k) {
        if (at >= row.size() || row[at] > row.size() - at - 1) {
            s.words.fail("cell " + std::to_string(k) + " runs beyond its list of " + std::to_string(size) + " numbers");
        }
        if (wanted) add_cell(s, std::span(row).subspan(at + 1, row[at]), strips);
        at += 1 + row[at];
    }
}

// Skips arrays that belong to the whole file.
void skip_field(VtkState& s) {
    s.words.next();
    for (uint64_t arrays = read_count(s, "a number of arrays"); arrays > 0; --arrays) {
        const std::string_view name = s.words.next();
        const uint64_t width = read_count(s, "a number of components"), rows = read_count(s, "a number of rows");
        const NamedScalar scalar = read_type(s);
        if (rows > 0 && width > (s.left() + 1) / rows) s.words.fail("array " + shown(name) + " is longer than the file");
        if (!scalar.number) s.words.fail("array " + shown(name) + " is of no numbers and not read");
        read_numbers(s, width * rows, scalar, [](double) {});
    }
}

// Skips metadata of the preceding array, up to an empty line.
void skip_metadata(VtkState& s) {
    s.words.rest_of_line();
    while (s.words.at != s.words.end) {
        if (s.words.rest_of_line().find_first_not_of(" \t") == std::string_view::npos) return;
    }
}

void read_head(VtkState& s) {
    s.words.rest_of_line();  // version
    s.words.rest_of_line();  // title
    const std::string_view coding = s.words.next();
    if (!same_word(coding, "ascii") && !same_word(coding, "binary")) {
        s.words.fail("expected ASCII or BINARY, found " + shown(coding));
    }
    s.binary = same_word(coding, "binary");
    const std::string_view data = s.words.next();
    if (!same_word(data, "dataset")) s.words.fail("expected DATASET, found " + shown(data));
    const std::string_view kind = s.words.next();
    if (!same_word(kind, "polydata")) s.words.fail("DATASET " + shown(kind) + " is not read, only POLYDATA");
}

}  // namespace

bool looks_like_vtk(std::string_view bytes) { return lower_case(bytes.substr(0, 14)) == "# vtk datafile"; }

LoadedMesh read_vtk(std::string_view bytes, const std::filesystem::path& path) {
    VtkState s{Words{bytes.data(), bytes.data() + bytes.size(), path}, false, {}, {}};
    read_head(s);
    s.loaded.format = s.binary ? "VTK binary" : "VTK ascii";
    while (true) {
        const std::string_view found = s.words.next();
        const std::string word = lower_case(found.substr(0, 32));
        if (word.empty()) break;
        if (word == "points") {
            read_points(s);
        } else if (word == "polygons" || word == "triangle_strips") {
            read_cells(s, true, word[0] == 't');
        } else if (word == "lines" || word == "vertices") {
            read_cells(s, false, false);
        } else if (word == "field") {
            skip_field(s);
        } else if (word == "metadata") {
            skip_metadata(s);
        } else if (word == "point_data" || word == "cell_data") {
            s.loaded.warnings.push_back(path.string() + ":" + std::to_string(s.words.line) + ": data of points and cells is passed over");
            break;  // the geometry is complete
        } else {
            s.words.fail("expected POINTS, POLYGONS or another part of POLYDATA, found " + shown(found));
        }
    }
    cut_polygons(s.polygons, s.loaded, path);
    s.loaded.mesh.material.emplace_back();
    return std::move(s.loaded);
}

}  // namespace trocar
