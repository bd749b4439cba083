#include "content/read/off_file.hpp"

#include <cmath>

#include "content/read/polygon_list.hpp"
#include "content/text/byte_order.hpp"
#include "content/text/number_text.hpp"
#include "content/text/words.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

// Vertex attributes besides the position, as announced by the letters before OFF.
struct Prefix {
    bool texture = false, colour = false, normal = false, homogeneous = false, other_dimension = false;
};

// True if the word is [ST][C][N][4][n]OFF.
bool read_prefix(std::string_view word, Prefix& prefix) {
    if (!word.ends_with("OFF")) return false;
    word.remove_suffix(3);
    const auto take = [&](std::string_view letters) {
        const bool there = word.starts_with(letters);
        if (there) word.remove_prefix(letters.size());
        return there;
    };
    prefix.texture = take("ST");
    prefix.colour = take("C");
    prefix.normal = take("N");
    prefix.homogeneous = take("4");
    prefix.other_dimension = take("n");
    return word.empty();
}

struct Counts {
    uint64_t vertices = 0, faces = 0;
};

uint32_t to_corner(const Words& words, double number) {
    if (!(number >= 0 && number < kNone) || number != std::floor(number)) {
        words.fail("a corner that is no number of a vertex");
    }
    return static_cast<uint32_t>(number);
}

// --- text

// The last two numbers of a line that has been read up to `at`.
Vec2 last_two_numbers(std::string_view rest) {
    double u = 0, v = 0;
    const char* at = rest.data();
    const char* const end = at + rest.size();
    while (at != end && *at != '#') {
        double value = 0;
        const char* const stop = parse_number(at, end, value);
        if (stop) {
            u = v;
            v = value;
        }
        at = stop ? stop : at + 1;
    }
    return texture_coordinate(u, v);
}

void read_text(Words& words, const Prefix& prefix, LoadedMesh& loaded, PolygonList& list) {
    const auto left = [&] { return static_cast<uint64_t>(words.end - words.at) / 2 + 1; };
    Counts counts;
    counts.vertices = words.count("a number of vertices", left());
    counts.faces = words.count("a number of faces", left());
    words.rest_of_line();  // the number of edges, which writers leave unset
    loaded.mesh.position.reserve(counts.vertices);
    for (uint64_t k = 0; k < counts.vertices; ++k) {
        Vec3d p;
        for (int c = 0; c < 3; ++c) p[c] = words.number();
        loaded.mesh.position.push_back(p);
        const std::string_view rest = words.rest_of_line();
        if (prefix.texture) list.point_uv.push_back(last_two_numbers(rest));
    }
    for (uint64_t k = 0; k < counts.faces; ++k) {
        for (uint64_t n = words.count("a number of corners", left()); n > 0; --n) {
            list.corner.push_back(to_corner(words, words.number()));
        }
        list.end.push_back(static_cast<uint32_t>(list.corner.size()));
        words.rest_of_line();  // colour of the face
    }
}

// --- bytes

struct BinaryWords {
    Words& words;

    uint64_t left() const { return static_cast<uint64_t>(words.end - words.at); }
    template <typename T>
    T next() {
        if (left() < sizeof(T)) words.fail("binary data is cut short");
        const T value = number_from_bytes<T>(words.at, true);
        words.at += sizeof(T);
        return value;
    }
    uint64_t count(const char* what, uint64_t bytes_each) {
        const auto value = next<int32_t>();
        if (value < 0 || static_cast<uint64_t>(value) > left() / bytes_each) {
            words.fail(std::string(what) + " " + std::to_string(value) + ": the file is too short for it");
        }
        return static_cast<uint64_t>(value);
    }
};

void read_bytes(Words& words, const Prefix& prefix, LoadedMesh& loaded, PolygonList& list) {
    BinaryWords bytes{words};
    const uint64_t each = 4 * (3u + (prefix.normal ? 3 : 0) + (prefix.colour ? 4 : 0) + (prefix.texture ? 2 : 0));
    Counts counts;
    counts.vertices = bytes.count("a number of vertices", each);
    counts.faces = bytes.count("a number of faces", 8);
    bytes.next<int32_t>();
    for (uint64_t k = 0; k < counts.vertices; ++k) {
        const char* const begin = words.at;
        Vec3d p;
        for (int c = 0; c < 3; ++c) p[c] = bytes.next<float>();
        if (!p.allFinite()) words.fail("vertex " + std::to_string(k) + " has a coordinate that is not finite");
        loaded.mesh.position.push_back(p);
        if (bytes.left() + 12 < each) words.fail("binary data is cut short");
        if (prefix.texture) {
            const char* const uv = begin + each - 8;
            list.point_uv.push_back(texture_coordinate(number_from_bytes<float>(uv, true), number_from_bytes<float>(uv + 4, true)));
        }
        words.at = begin + each;
    }
    for (uint64_t k = 0; k < counts.faces; ++k) {
        for (uint64_t n = bytes.count("a number of corners", 4); n > 0; --n) {
            list.corner.push_back(to_corner(words, bytes.next<int32_t>()));
        }
        list.end.push_back(static_cast<uint32_t>(list.corner.size()));
        words.at += 4 * bytes.count("a number of colour components", 4);
    }
}

}  // namespace

bool looks_like_off(std::string_view bytes) {
    if (bytes.starts_with("\xef\xbb\xbf")) bytes.remove_prefix(3);
    const std::filesystem::path nowhere;
    const std::string_view head = bytes.substr(0, 4096);
    Words words{head.data(), head.data() + head.size(), nowhere, 1, '#'};
    Prefix prefix;
    return read_prefix(words.next(), prefix);
}

LoadedMesh read_off(std::string_view bytes, const std::filesystem::path& path) {
    if (bytes.starts_with("\xef\xbb\xbf")) bytes.remove_prefix(3);
    Words words{bytes.data(), bytes.data() + bytes.size(), path, 1, '#'};
    Prefix prefix;
    read_prefix(words.next(), prefix);
    if (prefix.homogeneous || prefix.other_dimension) words.fail("only OFF files of three dimensions are read");
    LoadedMesh loaded;
    PolygonList list;
    const bool binary = words.peek() == "BINARY";
    loaded.format = binary ? "OFF binary" : "OFF";
    if (binary) {
        words.next();
        words.rest_of_line();
        read_bytes(words, prefix, loaded, list);
    } else {
        read_text(words, prefix, loaded, list);
    }
    cut_polygons(list, loaded, path);
    loaded.mesh.material.emplace_back();
    return loaded;
}

}  // namespace trocar
