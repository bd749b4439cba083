#include "content/read/obj_file.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "content/text/local_file.hpp"
#include "content/text/number_text.hpp"
#include "content/text/polygon.hpp"
#include "content/text/texture.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kMaterialFileLimit = uint64_t{1} << 26;  // bytes

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\v' || c == '\f' || c == '\0'; }

// One logical line at a time, without comments, lines joined at backslashes. CR, LF and CR LF end a line.
struct Lines {
    const char* at;
    const char* end;
    uint64_t number = 0;      // of the first physical line in the current one
    uint64_t joined = 0;      // number of physical lines in it
    std::string joined_text;  // used only for joined lines
    const fs::path& path;

    bool next(std::string_view& line) {
        number += joined;
        joined = 0;
        if (at == end) return false;
        line = next_physical();
        if (!line.empty() && line.back() == '\\') {
            joined_text.clear();
            while (!line.empty() && line.back() == '\\') {
                joined_text.append(line.substr(0, line.size() - 1));
                joined_text += ' ';
                line = at == end ? std::string_view{} : next_physical();
            }
            joined_text.append(line);
            line = joined_text;
        }
        const size_t comment = line.find('#');
        if (comment != std::string_view::npos) line = line.substr(0, comment);
        return true;
    }
    std::string_view next_physical() {
        ++joined;
        const char* const begin = at;
        while (at != end && *at != '\n' && *at != '\r') ++at;
        const std::string_view line(begin, static_cast<size_t>(at - begin));
        if (at != end && *at++ == '\r' && at != end && *at == '\n') ++at;
        return line;
    }
    std::string location() const { return path.string() + ":" + std::to_string(number + 1); }
    [[noreturn]] void fail(const std::string& reason) const { throw InputError(location() + ": " + reason); }
};

std::string_view next_word(std::string_view& rest) {
    size_t first = 0;
    while (first < rest.size() && is_blank(rest[first])) ++first;
    size_t last = first;
    while (last < rest.size() && !is_blank(rest[last])) ++last;
    const std::string_view word = rest.substr(first, last - first);
    rest.remove_prefix(last);
    return word;
}

std::string trimmed(std::string_view text) {
    while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
    while (!text.empty() && is_blank(text.back())) text.remove_suffix(1);
    return std::string(text);
}

std::string in_quotes(std::string_view text) {
    std::string out = "'";
    for (const char c : text.substr(0, 40)) out += c >= ' ' && c < 127 ? c : '?';
    return out + "'";
}

// Reads up to `wanted` finite numbers from the rest of a line; fails if there are fewer than `needed`.
int read_numbers(const Lines& lines, std::string_view rest, const char* what, int needed, int wanted, double* out) {
    const char* at = rest.data();
    const char* const end = at + rest.size();
    for (int k = 0; k < wanted; ++k) {
        while (at != end && is_blank(*at)) ++at;
        if (at == end && k >= needed) return k;
        const char* const stop = parse_number(at, end, out[k]);
        if (!stop || (stop != end && !is_blank(*stop)) || !std::isfinite(out[k])) {
            std::string_view word(at, static_cast<size_t>(end - at));
            lines.fail(std::string(what) + " needs " + std::to_string(needed) + " finite numbers, found " +
                       (at == end ? std::to_string(k) : in_quotes(next_word(word))));
        }
        at = stop;
    }
    return wanted;
}

// State of the reader.
struct ObjState {
    FileRoots roots;
    LoadedMesh loaded;
    std::vector<Vec2> uv;
    uint64_t normals = 0;
    std::map<std::string, uint16_t, std::less<>> material_row;
    std::vector<Material> known;  // from the material files
    std::map<std::string, size_t, std::less<>> known_row;
    uint16_t material = 0;
    PolygonScratch polygon;
    std::vector<Vec3d> corner;
    std::vector<uint32_t> vertex, texture;  // indices of the corners of a face
    std::vector<Triangle> cut;
    uint64_t fanned = 0;
    std::set<std::string, std::less<>> passed_over;
};

// Reads one index of a corner and converts it to zero-based. Files count from 1, or from the end if negative.
uint32_t read_row(const Lines& lines, const char*& at, const char* end, uint64_t count, const char* what) {
    const char* const begin = at;
    const bool negative = at != end && *at == '-';
    if (negative) ++at;
    uint64_t value = 0;
    const char* const digits = at;
    while (at != end && *at >= '0' && *at <= '9') {
        value = value < uint64_t{1} << 40 ? value * 10 + static_cast<uint64_t>(*at - '0') : value;
        ++at;
    }
    if (at == digits) lines.fail(std::string("expected the number of a ") + what);
    if (value == 0) lines.fail(std::string(what) + " number 0: they count from 1");
    if (value > count) {
        lines.fail(std::string(what) + " number " + std::string(begin, at) + " when there are " + std::to_string(count));
    }
    return static_cast<uint32_t>(negative ? count - value : value - 1);
}

void read_corner(const Lines& lines, ObjState& s, std::string_view word) {
    const char* at = word.data();
    const char* const end = at + word.size();
    s.vertex.push_back(read_row(lines, at, end, s.loaded.mesh.position.size(), "vertex"));
    uint32_t texture = kNone;
    if (at != end && *at == '/') {
        ++at;
        if (at != end && *at != '/') texture = read_row(lines, at, end, s.uv.size(), "texture coordinate");
        if (at != end && *at == '/' && ++at != end) read_row(lines, at, end, s.normals, "normal");
    }
    if (at != end) lines.fail("a corner that is not v, v/vt, v//vn or v/vt/vn: " + in_quotes(word));
    s.texture.push_back(texture);
}

void read_face(const Lines& lines, ObjState& s, std::string_view rest) {
    Mesh& mesh = s.loaded.mesh;
    s.vertex.clear();
    s.texture.clear();
    bool textured = false;
    for (std::string_view word = next_word(rest); !word.empty(); word = next_word(rest)) {
        read_corner(lines, s, word);
        textured = textured || s.texture.back() != kNone;
    }
    const size_t n = s.vertex.size();
    if (n < 3) lines.fail("a face with " + std::to_string(n) + " corners");
    s.cut.clear();
    if (n == 3) {
        s.cut.push_back({0, 1, 2});
    } else {
        s.corner.resize(n);
        for (size_t k = 0; k < n; ++k) s.corner[k] = mesh.position[s.vertex[k]];
        if (!triangulate_polygon(s.corner, s.polygon, s.cut)) ++s.fanned;
    }
    // uv entries start with the first face that has any
    if (textured && mesh.uv.empty()) mesh.uv.resize(mesh.triangle.size());
    const bool with_uv = textured || !mesh.uv.empty();
    for (const Triangle& t : s.cut) {
        mesh.triangle.push_back({s.vertex[t[0]], s.vertex[t[1]], s.vertex[t[2]]});
        mesh.triangle_material.push_back(s.material);
        if (!with_uv) continue;
        std::array<Vec2, 3> uv;
        for (size_t k = 0; k < 3; ++k) uv[k] = s.texture[t[k]] == kNone ? Vec2{} : s.uv[s.texture[t[k]]];
        mesh.uv.push_back(uv);
    }
}

void warn_once(ObjState& s, const std::string& key, const std::string& text) {
    if (s.passed_over.size() < 100 && s.passed_over.insert(key).second) s.loaded.warnings.push_back(text);
}

// The file name in a map line: options begin with '-' and take numbers, on/off or one letter.
std::string texture_name(std::string_view rest) {
    while (true) {
        std::string_view after = rest;
        const std::string_view word = next_word(after);
        if (word.size() < 2 || word[0] != '-') return trimmed(rest);
        const int most = word == "-o" || word == "-s" || word == "-t" ? 3 : word == "-mm" ? 2 : 1;
        rest = after;
        for (int k = 0; k < most; ++k) {
            const std::string_view argument = next_word(after);
            double ignored;
            const char* const stop = parse_number(argument.data(), argument.data() + argument.size(), ignored);
            const bool number = stop && stop == argument.data() + argument.size();
            if (k > 0 && !number) break;  // -o, -s and -t accept u alone
            rest = after;
        }
    }
}

void read_material_line(const Lines& lines, ObjState& s, std::string_view key, std::string_view rest) {
    if (key == "newmtl") {
        Material material;
        material.name = trimmed(rest);
        s.known_row[material.name] = s.known.size();
        s.known.push_back(std::move(material));
        return;
    }
    if (s.known.empty()) return;
    Material& material = s.known.back();
    double value[3] = {};
    const auto unit = [](double x) { return static_cast<float>(std::min(std::max(x, 0.0), 1.0)); };
    if (key == "Kd" || key == "Ks") {
        std::string_view first = rest;
        const std::string_view word = next_word(first);
        if (word == "spectral" || word == "xyz") return;
        const int given = read_numbers(lines, rest, key == "Kd" ? "Kd" : "Ks", 1, 3, value);
        auto& colour = key == "Kd" ? material.diffuse : material.specular;
        for (int c = 0; c < 3; ++c) colour[static_cast<size_t>(c)] = unit(value[given == 3 ? c : 0]);
    } else if (key == "Ns") {
        // exponent of Phong's model; VRML's shininess 1 is an exponent of 128
        read_numbers(lines, rest, "Ns", 1, 1, value);
        material.shininess = unit(value[0] / 128);
    } else if (key == "d" || key == "Tr") {
        if (key == "d" && trimmed(rest).starts_with("-halo")) return;
        read_numbers(lines, rest, key == "d" ? "d" : "Tr", 1, 1, value);
        material.transparency = key == "d" ? 1 - unit(value[0]) : unit(value[0]);
    } else if (key == "map_Kd") {
        material.texture = texture_name(rest);
    }
}

void read_material_file(ObjState& s, const Lines& from, const std::string& name) {
    const LocalFile file = find_local_file(s.roots, from.path.parent_path(), name);
    if (!file.refusal.empty()) {
        return warn_once(s, "mtllib " + name, from.location() + ": material file " + in_quotes(name) + " is not read: " + file.refusal);
    }
    try {
        const std::string text = read_text_file(file.path, kMaterialFileLimit);
        Lines lines{text.data(), text.data() + text.size(), 0, 0, {}, file.path};
        std::string_view rest;
        while (lines.next(rest)) {
            const std::string_view key = next_word(rest);
            read_material_line(lines, s, key, rest);
        }
    } catch (const InputError& error) {
        s.loaded.warnings.push_back(std::string("rest of the material file passed over: ") + error.what());
    }
}

// mtllib takes several names, but names contain blanks in practice: the whole rest is tried first.
void read_material_files(ObjState& s, const Lines& lines, std::string_view rest) {
    const std::string whole = trimmed(rest);
    if (whole.find(' ') == std::string::npos || find_local_file(s.roots, lines.path.parent_path(), whole).refusal.empty()) {
        return read_material_file(s, lines, whole);
    }
    for (std::string_view word = next_word(rest); !word.empty(); word = next_word(rest)) {
        read_material_file(s, lines, std::string(word));
    }
}

void use_material(ObjState& s, const Lines& lines, std::string_view rest) {
    const std::string name = trimmed(rest);
    std::vector<Material>& material = s.loaded.mesh.material;
    // faces before the first usemtl get a default material
    if (material.empty() && !s.loaded.mesh.triangle.empty()) material.emplace_back();
    const auto used = s.material_row.find(name);
    if (used != s.material_row.end()) {
        s.material = used->second;
        return;
    }
    if (material.size() >= 65535) lines.fail("more than 65535 materials");
    const auto known = s.known_row.find(name);
    if (known == s.known_row.end()) {
        warn_once(s, "usemtl " + name, lines.location() + ": material " + in_quotes(name) + " is not defined");
        material.emplace_back();
        material.back().name = name;
    } else {
        material.push_back(s.known[known->second]);
        if (!material.back().texture.empty()) {
            const std::string trouble = load_texture(s.roots, lines.path.parent_path(), material.back());
            if (!trouble.empty()) warn_once(s, trouble, lines.location() + ": " + trouble);
        }
    }
    s.material = static_cast<uint16_t>(material.size() - 1);
    s.material_row.emplace(name, s.material);
}

void read_line(const Lines& lines, ObjState& s, std::string_view key, std::string_view rest) {
    double value[3] = {};
    if (key == "v") {
        read_numbers(lines, rest, "v", 3, 3, value);
        if (s.loaded.mesh.position.size() + 1 >= kNone) lines.fail("more vertices than 32 bits can number");
        s.loaded.mesh.position.emplace_back(value[0], value[1], value[2]);
    } else if (key == "vt") {
        read_numbers(lines, rest, "vt", 1, 2, value);
        s.uv.push_back({static_cast<float>(value[0]), static_cast<float>(value[1])});
    } else if (key == "vn") {
        ++s.normals;
    } else if (key == "f" || key == "fo") {
        read_face(lines, s, rest);
    } else if (key == "usemtl") {
        use_material(s, lines, rest);
    } else if (key == "mtllib") {
        read_material_files(s, lines, rest);
    } else {
        // these lines (groups, smoothing, lines, points of free-form curves) do not affect the surface
        static constexpr std::string_view kIgnored[] = {"g", "o", "s", "l", "p", "vp", "mg", "lod", "usemap", "maplib"};
        for (const std::string_view ignored : kIgnored) {
            if (key == ignored) return;
        }
        warn_once(s, std::string(key), lines.location() + ": lines that begin with " + in_quotes(key) + " are passed over");
    }
}

}  // namespace

LoadedMesh read_obj(std::string_view text, const fs::path& path, const FileRoots& roots) {
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
    ObjState s;
    s.roots = roots;
    s.loaded.format = "OBJ";
    Lines lines{text.data(), text.data() + text.size(), 0, 0, {}, path};
    std::string_view rest;
    while (lines.next(rest)) {
        const std::string_view key = next_word(rest);
        if (!key.empty()) read_line(lines, s, key, rest);
    }
    if (s.loaded.mesh.material.empty()) s.loaded.mesh.material.emplace_back();
    if (s.fanned > 0) {
        s.loaded.warnings.push_back(path.string() + ": " + std::to_string(s.fanned) +
                                    " polygons cut as a fan: crossing themselves or without area");
    }
    return std::move(s.loaded);
}

}  // namespace trocar
