#include "content/stl_file.hpp"

#include <cmath>
#include <cstring>

#include "content/number_text.hpp"
#include "engine/error.hpp"
namespace trocar {
namespace {

constexpr size_t kHeader = 84, kFacet = 50;

uint32_t read_count(std::string_view bytes) {
    uint32_t count;
    std::memcpy(&count, bytes.data() + 80, 4);
    return count;
}

// Words of an ascii file, with the line they stand in.
struct Words {
    const char* at;
    const char* end;
    uint64_t line = 1;
    const std::filesystem::path& path;

    [[noreturn]] void fail(const std::string& reason) const {
        throw InputError(path.string() + ":" + std::to_string(line) + ": " + reason);
    }
    void skip_blanks() {
        for (; at != end && static_cast<unsigned char>(*at) <= ' '; ++at) line += *at == '\n';
    }
    // The next word, empty at the end of the file.
    std::string_view next() {
        skip_blanks();
        const char* const begin = at;
        while (at != end && static_cast<unsigned char>(*at) > ' ') ++at;
        return {begin, static_cast<size_t>(at - begin)};
    }
    void skip_line() {
        while (at != end && *at != '\n' && *at != '\r') ++at;
    }
};

bool same_word(std::string_view word, std::string_view lower) {
    if (word.size() != lower.size()) return false;
    for (size_t i = 0; i < word.size(); ++i) {
        if ((word[i] | 0x20) != lower[i]) return false;
    }
    return true;
}

std::string shown(std::string_view word) {
    if (word.empty()) return "the end of the file";
    std::string text = "'";
    for (const char c : word.substr(0, 40)) text += c > ' ' && c < 127 ? c : '?';
    return text + "'";
}

void expect(Words& words, std::string_view wanted, const char* where) {
    const std::string_view word = words.next();
    if (!same_word(word, wanted)) {
        words.fail("expected '" + std::string(wanted) + "' " + where + ", found " + shown(word));
    }
}

double expect_number(Words& words, bool may_be_bad) {
    const std::string_view word = words.next();
    double value = 0;
    const char* const end = parse_number(word.data(), word.data() + word.size(), value);
    const bool good = !word.empty() && end == word.data() + word.size() && std::isfinite(value);
    if (!good && !may_be_bad) words.fail("expected a finite coordinate, found " + shown(word));
    if (word.empty()) words.fail("the file ends inside a facet");
    return value;
}

}  // namespace

bool is_binary_stl(std::string_view bytes) {
    return bytes.size() >= kHeader && bytes.size() == kHeader + kFacet * static_cast<size_t>(read_count(bytes));
}

LoadedMesh read_binary_stl(std::string_view bytes, const std::filesystem::path& path) {
    const auto fail = [&](const std::string& reason) { throw InputError(path.string() + ": " + reason); };
    if (bytes.size() < kHeader) fail("binary STL is cut short inside its header");
    const uint32_t count = read_count(bytes);
    const size_t room = (bytes.size() - kHeader) / kFacet;
    if (count > room) {
        fail("binary STL names " + std::to_string(count) + " facets but holds only " + std::to_string(room));
    }
    LoadedMesh loaded;
    loaded.format = "STL binary";
    if (bytes.size() > kHeader + kFacet * static_cast<size_t>(count)) {
        loaded.warnings.push_back(path.string() + ": bytes after the last facet are ignored");
    }
    Mesh& mesh = loaded.mesh;
    mesh.position.resize(3 * static_cast<size_t>(count));
    mesh.triangle.resize(count);
    for (uint32_t f = 0; f < count; ++f) {
        float corner[9];
        std::memcpy(corner, bytes.data() + kHeader + kFacet * f + 12, sizeof corner);
        for (uint32_t k = 0; k < 3; ++k) {
            const Vec3d p(corner[3 * k], corner[3 * k + 1], corner[3 * k + 2]);
            if (!p.allFinite()) fail("facet " + std::to_string(f) + " has a coordinate that is not finite");
            mesh.position[3 * f + k] = p;
            mesh.triangle[f][k] = 3 * f + k;
        }
    }
    return loaded;
}

LoadedMesh read_ascii_stl(std::string_view text, const std::filesystem::path& path) {
    Words words{text.data(), text.data() + text.size(), 1, path};
    LoadedMesh loaded;
    loaded.format = "STL ascii";
    Mesh& mesh = loaded.mesh;
    bool inside = false;
    while (true) {
        const std::string_view word = words.next();
        if (!inside) {
            if (word.empty()) break;
            if (!same_word(word, "solid")) words.fail("expected 'solid', found " + shown(word));
            words.skip_line();
            inside = true;
        } else if (same_word(word, "endsolid")) {
            words.skip_line();
            inside = false;
        } else if (same_word(word, "facet")) {
            expect(words, "normal", "after 'facet'");
            for (int k = 0; k < 3; ++k) expect_number(words, true);  // writers put nan into normals of flat facets
            expect(words, "outer", "after the normal");
            expect(words, "loop", "after 'outer'");
            if (mesh.position.size() + 3 >= kNone) words.fail("more facets than 32 bits can number");
            const auto first = static_cast<uint32_t>(mesh.position.size());
            for (int k = 0; k < 3; ++k) {
                expect(words, "vertex", "in a facet (three in each)");
                Vec3d p;
                for (int c = 0; c < 3; ++c) p[c] = expect_number(words, false);
                mesh.position.push_back(p);
            }
            expect(words, "endloop", "after three vertices");
            expect(words, "endfacet", "after 'endloop'");
            mesh.triangle.push_back({first, first + 1, first + 2});
        } else {
            words.fail(word.empty() ? "the file ends without 'endsolid'"
                                    : "expected 'facet' or 'endsolid', found " + shown(word));
        }
    }
    return loaded;
}

}  // namespace trocar
