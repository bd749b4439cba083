#include "content/read/stl_file.hpp"

#include <cstring>

#include "content/text/words.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

constexpr size_t kHeader = 84, kFacet = 50;

uint32_t read_count(std::string_view bytes) {
    uint32_t count;
    std::memcpy(&count, bytes.data() + 80, 4);
    return count;
}

void expect(Words& words, std::string_view wanted, const char* where) {
    const std::string_view word = words.next();
    if (!same_word(word, wanted)) {
        words.fail("expected '" + std::string(wanted) + "' " + where + ", found " + shown(word));
    }
}

}  // namespace

bool is_binary_stl(std::string_view bytes) {
    return bytes.size() >= kHeader && bytes.size() == kHeader + kFacet * static_cast<size_t>(read_count(bytes));
}

LoadedMesh read_binary_stl(std::string_view bytes, const std::filesystem::path& path) {
    const auto fail = [&](const std::string& reason) { throw InputError(path.string() + ": " + reason); };
    if (bytes.size() < kHeader) fail("binary STL is cut short inside its header");
    uint32_t count = read_count(bytes);
    const size_t room = (bytes.size() - kHeader) / kFacet;
    LoadedMesh loaded;
    loaded.format = "STL binary";
    if (count == 0 && room > 0 && room < kNone / 3 && bytes.size() == kHeader + kFacet * room) {
        // a program that did not know the number when it began to write
        loaded.warnings.push_back(path.string() + ": the header names 0 facets; the " + std::to_string(room) + " that follow it are read");
        count = static_cast<uint32_t>(room);
    }
    if (count > room) {
        fail("binary STL names " + std::to_string(count) + " facets but holds only " + std::to_string(room));
    }
    if (const size_t used = kHeader + kFacet * static_cast<size_t>(count); bytes.size() > used) {
        loaded.warnings.push_back(path.string() + ": " + std::to_string(bytes.size() - used) + " bytes after the last facet are ignored");
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
    Words words{text.data(), text.data() + text.size(), path};
    LoadedMesh loaded;
    loaded.format = "STL ascii";
    Mesh& mesh = loaded.mesh;
    bool inside = false;
    while (true) {
        const std::string_view word = words.next();
        if (!inside) {
            if (word.empty()) break;
            if (!same_word(word, "solid")) words.fail("expected 'solid', found " + shown(word));
            words.rest_of_line();
            inside = true;
        } else if (same_word(word, "endsolid")) {
            words.rest_of_line();
            inside = false;
        } else if (same_word(word, "facet")) {
            expect(words, "normal", "after 'facet'");
            for (int k = 0; k < 3; ++k) words.number(true);  // writers may put NaN into normals
            expect(words, "outer", "after the normal");
            expect(words, "loop", "after 'outer'");
            if (mesh.position.size() + 3 >= kNone) words.fail("more facets than 32 bits can number");
            const auto first = static_cast<uint32_t>(mesh.position.size());
            for (int k = 0; k < 3; ++k) {
                expect(words, "vertex", "in a facet (three in each)");
                Vec3d p;
                for (int c = 0; c < 3; ++c) p[c] = words.number();
                mesh.position.push_back(p);
            }
            expect(words, "endloop", "after three vertices");
            expect(words, "endfacet", "after 'endloop'");
            mesh.triangle.push_back({first, first + 1, first + 2});
        } else {
            words.fail(word.empty() ? "the file ends without 'endsolid'" : "expected 'facet' or 'endsolid', found " + shown(word));
        }
    }
    return loaded;
}

}  // namespace trocar
