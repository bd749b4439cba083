#include "content/shapes/mesh_source.hpp"

#include <charconv>
#include <vector>

#include "content/shapes/shape_library.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

constexpr uint32_t kTriangles = 10000;

template <typename Number>
Number parse_count(const std::string& source, const std::string& word) {
    Number value{};
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size()) {
        throw InputError(source + ": \"" + word + "\" is not a whole number; write shape:NAME:TRIANGLES:SEED");
    }
    return value;
}

std::vector<std::string> split_at_colons(const std::string& text) {
    std::vector<std::string> words(1);
    for (const char c : text) {
        if (c == ':') {
            words.emplace_back();
        } else {
            words.back() += c;
        }
    }
    return words;
}

}  // namespace

LoadedMesh load_mesh_or_shape(const std::string& source, const LoadOptions& options) {
    const std::vector<std::string> words = split_at_colons(source);
    std::error_code error;
    const bool bare = words.size() == 1 && !describe_shape(source).empty() && !std::filesystem::exists(source, error);
    const bool shape = bare || (words.size() > 1 && words[0] == "shape");
    if (!shape) return load_mesh(source, options);
    if (words.size() > 4) throw InputError(source + ": write shape:NAME:TRIANGLES:SEED");
    LoadedMesh loaded;
    loaded.format = "shape";
    loaded.mesh = make_shape(bare ? words[0] : words[1], words.size() > 2 ? parse_count<uint32_t>(source, words[2]) : kTriangles,
                             words.size() > 3 ? parse_count<uint64_t>(source, words[3]) : 1);
    return loaded;
}

}  // namespace trocar
