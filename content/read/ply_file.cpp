#include "content/read/ply_file.hpp"

#include <algorithm>
#include <cmath>

#include "content/read/polygon_list.hpp"
#include "content/text/byte_order.hpp"
#include "content/text/texture.hpp"
#include "content/text/words.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

struct Property {
    std::string name;
    bool list = false;
    Scalar count = Scalar::kUint8;  // type of a list's length
    Scalar type = Scalar::kFloat;
};

struct Element {
    std::string name;
    uint64_t rows = 0;
    std::vector<Property> property;
};

enum class Coding : uint8_t { kAscii, kLittle, kBig };

struct Header {
    Coding coding = Coding::kAscii;
    std::vector<Element> element;
    std::string texture;
    std::vector<std::string> warnings;
};

// Source of the element rows. Text and binary give the same numbers.
struct Source {
    Words words;  // its position is valid for both codings
    Coding coding = Coding::kAscii;
    const std::string* element = nullptr;
    uint64_t row = 0;

    [[noreturn]] void fail(const std::string& reason) const {
        if (coding == Coding::kAscii) words.fail(reason);
        throw InputError(words.path.string() + ": " + *element + " " + std::to_string(row) + ": " + reason);
    }
    uint64_t left() const { return static_cast<uint64_t>(words.end - words.at); }
};

double read_binary(Source& s, Scalar type) {
    const char* const at = s.words.at;
    if (s.left() < scalar_bytes(type)) s.fail("the file ends here");
    s.words.at += scalar_bytes(type);
    return scalar_from_bytes(at, type, s.coding == Coding::kBig);
}

// Reads a number that may be NaN: the caller must check.
double read_scalar(Source& s, Scalar type) { return s.coding == Coding::kAscii ? s.words.number(true) : read_binary(s, type); }

uint64_t read_list_count(Source& s, const Property& p) {
    const double count = read_scalar(s, p.count);
    if (!(count >= 0) || count != std::floor(count)) s.fail("a list of '" + p.name + "' without a whole count");
    const uint64_t size = s.coding == Coding::kAscii ? 2 : scalar_bytes(p.type);
    if (count > static_cast<double>((s.left() + 1) / size)) s.fail("a list that is longer than the file");
    return static_cast<uint64_t>(count);
}

// --- header

std::vector<std::string_view> split(std::string_view line) {
    std::vector<std::string_view> word;
    while (true) {
        const size_t first = line.find_first_not_of(" \t\v\f");
        if (first == std::string_view::npos) return word;
        const size_t last = std::min(line.find_first_of(" \t\v\f", first), line.size());
        word.push_back(line.substr(first, last - first));
        line.remove_prefix(last);
    }
}

Scalar read_type(const Words& words, std::string_view name) {
    constexpr std::string_view kNames[][2] = {{"char", "int8"}, {"uchar", "uint8"}, {"short", "int16"},   {"ushort", "uint16"},
                                              {"int", "int32"}, {"uint", "uint32"}, {"float", "float32"}, {"double", "float64"}};
    for (size_t k = 0; k < std::size(kNames); ++k) {
        if (name == kNames[k][0] || name == kNames[k][1]) return static_cast<Scalar>(k);
    }
    words.fail("unknown type " + shown(name) + " of a property");
}

void read_header_line(const Words& words, const std::vector<std::string_view>& word, Header& header) {
    if (word[0] == "format") {
        const std::string_view name = word.size() > 1 ? word[1] : "";
        header.coding = name == "ascii"                  ? Coding::kAscii
                        : name == "binary_little_endian" ? Coding::kLittle
                        : name == "binary_big_endian"    ? Coding::kBig
                                                         : (words.fail("unknown format " + shown(name)), Coding::kBig);
    } else if (word[0] == "element") {
        if (word.size() != 3) words.fail("an element needs a name and a number of rows");
        Words number{word[2].data(), word[2].data() + word[2].size(), words.path, words.line};
        header.element.push_back({std::string(word[1]), number.count("a number of rows", uint64_t{1} << 60), {}});
    } else if (word[0] == "property") {
        if (header.element.empty()) words.fail("a property before any element");
        Property property;
        property.list = word.size() == 5 && word[1] == "list";
        if (word.size() != (property.list ? 5u : 3u)) words.fail("a property needs a type and a name");
        if (property.list) property.count = read_type(words, word[2]);
        property.type = read_type(words, word[word.size() - 2]);
        property.name = word.back();
        header.element.back().property.push_back(property);
    } else if (word[0] == "comment" || word[0] == "obj_info") {
        if (word.size() > 2 && word[1] == "TextureFile") {
            header.texture.assign(word[2].data(), word.back().data() + word.back().size());
        }
    } else {
        header.warnings.push_back(words.path.string() + ":" + std::to_string(words.line) + ": unknown line " + shown(word[0]) +
                                  " in the header is passed over");
    }
}

// Reads up to and including the line end_header.
Header read_header(Words& words) {
    const bool carriage_only = words.end - words.at > 4 && words.at[3] == '\r' && words.at[4] != '\n';
    Header header;
    bool formatted = false;
    words.rest_of_line();
    while (true) {
        if (words.at == words.end) words.fail("the file ends before end_header");
        const Words here = words;
        const std::vector<std::string_view> word = split(words.rest_of_line());
        if (word.empty()) continue;
        if (word[0] == "end_header") {
            // if CR alone ends lines, a following line feed is already data
            if (carriage_only && words.at - 2 >= here.at && words.at[-1] == '\n' && words.at[-2] == '\r') --words.at;
            break;
        }
        formatted = formatted || word[0] == "format";
        read_header_line(here, word, header);
        if (header.warnings.size() > 100) words.fail("more than 100 lines of the header are unknown");
    }
    if (!formatted) words.fail("a header without a line that begins with 'format'");
    return header;
}

// --- rows

int find_property(const Element& element, std::initializer_list<std::string_view> names, bool list) {
    for (const std::string_view name : names) {
        for (size_t k = 0; k < element.property.size(); ++k) {
            if (element.property[k].name == name && element.property[k].list == list) return static_cast<int>(k);
        }
    }
    return -1;
}

void check_room(const Source& s, const Element& element) {
    uint64_t least = 0;
    for (const Property& p : element.property) {
        const Scalar type = p.list ? p.count : p.type;
        least += s.coding == Coding::kAscii ? 2 : scalar_bytes(type);
    }
    if (least > 0 && element.rows > (s.left() + 1) / least) {
        s.words.fail("the header names " + std::to_string(element.rows) + " rows of '" + element.name +
                     "', the file has room for no more than " + std::to_string((s.left() + 1) / least));
    }
}

// Reads one row: scalars into `value`, requested lists into `list`; others are skipped.
void read_row(Source& s, const Element& element, std::vector<double>& value, int wanted, std::vector<double>& list, int also_wanted,
              std::vector<double>& also) {
    for (size_t k = 0; k < element.property.size(); ++k) {
        const Property& p = element.property[k];
        if (!p.list) {
            value[k] = read_scalar(s, p.type);
            continue;
        }
        std::vector<double>* const out = static_cast<int>(k) == wanted ? &list : static_cast<int>(k) == also_wanted ? &also : nullptr;
        if (out) out->clear();
        for (uint64_t left = read_list_count(s, p); left > 0; --left) {
            const double number = read_scalar(s, p.type);
            if (out) out->push_back(number);
        }
    }
}

void read_vertices(Source& s, const Element& element, const std::string& wanted, LoadedMesh& loaded, PolygonList& list,
                   std::vector<double>* field) {
    const int column[] = {find_property(element, {"x"}, false), find_property(element, {"y"}, false), find_property(element, {"z"}, false)};
    if (column[0] < 0 || column[1] < 0 || column[2] < 0) s.words.fail("the vertices have no x, y and z");
    const int u = find_property(element, {"s", "u", "texture_u", "texture_s"}, false);
    const int v = find_property(element, {"t", "v", "texture_v", "texture_t"}, false);
    if (find_property(element, {"red", "diffuse_red", "r"}, false) >= 0) {
        loaded.warnings.push_back(s.words.path.string() + ": colours of vertices are passed over");
    }
    const int painted = field ? find_property(element, {wanted}, false) : -1;
    if (field && painted < 0) throw InputError(s.words.path.string() + ": the vertices have no number \"" + wanted + "\"");
    std::vector<double> value(element.property.size()), unused;
    loaded.mesh.position.reserve(loaded.mesh.position.size() + element.rows);
    for (s.row = 0; s.row < element.rows; ++s.row) {
        read_row(s, element, value, -1, unused, -1, unused);
        Vec3d p;
        for (int k = 0; k < 3; ++k) p[k] = value[static_cast<size_t>(column[k])];
        if (!p.allFinite()) s.fail("a coordinate that is not finite");
        loaded.mesh.position.push_back(p);
        if (field) {
            field->push_back(value[static_cast<size_t>(painted)]);
            if (!std::isfinite(field->back())) s.fail("a number \"" + wanted + "\" that is not finite");
        }
        if (u < 0 || v < 0) continue;
        list.point_uv.push_back(texture_coordinate(value[static_cast<size_t>(u)], value[static_cast<size_t>(v)]));
    }
}

void read_faces(Source& s, const Element& element, PolygonList& list) {
    const int indices = find_property(element, {"vertex_indices", "vertex_index"}, true);
    const int texture = find_property(element, {"texcoord"}, true);
    const bool strips = element.name == "tristrips";
    if (indices < 0 && element.rows > 0) s.words.fail("the faces have no list vertex_indices");
    std::vector<double> value(element.property.size()), row, uv;
    std::vector<uint32_t> strip;
    for (s.row = 0; s.row < element.rows; ++s.row) {
        read_row(s, element, value, indices, row, texture, uv);
        strip.clear();
        for (const double number : row) {
            if (strips && number == -1) {
                add_strip(strip, list);
                strip.clear();
                continue;
            }
            if (!(number >= 0 && number < kNone) || number != std::floor(number)) {
                s.fail("a corner that is no number of a vertex");
            }
            strip.push_back(static_cast<uint32_t>(number));
        }
        if (list.corner.size() + row.size() >= kNone) s.fail("more corners than 32 bits can number");
        if (strips) {
            add_strip(strip, list);
            continue;
        }
        list.corner.insert(list.corner.end(), strip.begin(), strip.end());
        list.end.push_back(static_cast<uint32_t>(list.corner.size()));
        if (texture < 0) continue;
        uv.resize(2 * row.size());  // a face may have no texture coordinates
        for (size_t k = 0; k < row.size(); ++k) list.corner_uv.push_back(texture_coordinate(uv[2 * k], uv[2 * k + 1]));
    }
}

void skip_rows(Source& s, const Element& element) {
    std::vector<double> value(element.property.size()), unused;
    for (s.row = 0; !element.property.empty() && s.row < element.rows; ++s.row) {
        read_row(s, element, value, -1, unused, -1, unused);
    }
}

}  // namespace

bool looks_like_ply(std::string_view bytes) {
    return bytes.starts_with("ply") && bytes.size() > 3 && static_cast<unsigned char>(bytes[3]) <= ' ';
}

namespace {

LoadedMesh read_any_ply(std::string_view bytes, const std::filesystem::path& path, const FileRoots& roots, const std::string& property,
                        std::vector<double>* field) {
    Source source{Words{bytes.data(), bytes.data() + bytes.size(), path}};
    const Header header = read_header(source.words);
    source.coding = header.coding;
    LoadedMesh loaded;
    loaded.warnings = header.warnings;
    loaded.format = header.coding == Coding::kAscii ? "PLY ascii" : "PLY binary";
    PolygonList list;
    for (const Element& element : header.element) {
        source.element = &element.name;
        check_room(source, element);
        if (element.name == "vertex" && loaded.mesh.position.empty()) {
            read_vertices(source, element, property, loaded, list, field);
        } else if (element.name == "face" || element.name == "tristrips") {
            read_faces(source, element, list);
        } else {
            skip_rows(source, element);
        }
    }
    // strips have no texture coordinates, and coordinates for some corners only would not match
    if (list.corner_uv.size() != list.corner.size()) list.corner_uv.clear();
    cut_polygons(list, loaded, path);
    Material material;
    material.texture = header.texture;
    if (!material.texture.empty()) {
        const std::string trouble = load_texture(roots, path.parent_path(), material);
        if (!trouble.empty()) loaded.warnings.push_back(path.string() + ": " + trouble);
    }
    loaded.mesh.material.push_back(std::move(material));
    return loaded;
}

}  // namespace

LoadedMesh read_ply(std::string_view bytes, const std::filesystem::path& path, const FileRoots& roots) {
    return read_any_ply(bytes, path, roots, "", nullptr);
}

LoadedMesh read_painted_ply(std::string_view bytes, const std::filesystem::path& path, const std::string& property,
                            std::vector<double>& field) {
    return read_any_ply(bytes, path, {}, property, &field);
}

}  // namespace trocar
