// Some malformed text meets assertions of the parser (toml++ 3.3) instead of its errors; without them it would go on into
// undefined behaviour. They are errors here, in every build.
namespace trocar {
struct ParserIsLost {};
[[noreturn]] static void parser_is_lost() { throw ParserIsLost{}; }
}  // namespace trocar
#undef NDEBUG
#define TOML_ASSERT(expr) ((expr) ? static_cast<void>(0) : ::trocar::parser_is_lost())
#define TOML_IMPLEMENTATION
#include "content/toml_section.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <numbers>
#include <sstream>

#include "engine/error.hpp"
#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

// Levenshtein distance, for suggestions.
size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<size_t> row(b.size() + 1);
    for (size_t j = 0; j <= b.size(); ++j) row[j] = j;
    for (size_t i = 1; i <= a.size(); ++i) {
        size_t diagonal = row[0];
        row[0] = i;
        for (size_t j = 1; j <= b.size(); ++j) {
            const size_t above = row[j];
            row[j] = std::min({row[j] + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0u : 1u)});
            diagonal = above;
        }
    }
    return row[b.size()];
}

// First line that no text starting like this one can hold: where the parser is lost when it reads no farther.
size_t line_of_no_return(const std::string& text, const std::string& file) {
    size_t line = 1;
    for (size_t end = text.find('\n'); end != std::string::npos; end = text.find('\n', end + 1), ++line) {
        try {
            static_cast<void>(toml::parse(std::string_view(text).substr(0, end), file));
        } catch (const ParserIsLost&) {
            return line;
        } catch (const toml::parse_error&) {
            // the end of the text came too soon for it
        }
    }
    return line;
}

}  // namespace

std::string place(const std::string& file, const toml::source_region& source) {
    if (source.begin.line == 0) return file + ": ";  // came from the command line
    return file + ":" + std::to_string(source.begin.line) + ":" + std::to_string(source.begin.column) + ": ";
}

std::string nearest(std::string_view word, const std::vector<std::string>& known) {
    std::string best;
    size_t best_distance = std::max<size_t>(2, word.size() / 2) + 1;
    for (const std::string& k : known) {
        const size_t d = edit_distance(word, k);
        if (d < best_distance) best = k, best_distance = d;
    }
    return best;
}

toml::table read_toml(const std::filesystem::path& path, const std::string& what) {
    const std::string file = path.string();
    std::error_code error;
    if (std::filesystem::is_directory(path, error)) throw InputError(file + ": is a folder, not a " + what);
    std::ifstream stream(path, std::ios::binary);
    if (!stream) throw InputError(file + ": cannot be opened (" + std::string(std::strerror(errno)) + ")");
    std::ostringstream text;
    text << stream.rdbuf();
    try {
        return toml::parse(text.str(), file);
    } catch (const toml::parse_error& e) {
        std::string reason(e.description());  // may repeat what was read, line ends too
        std::replace_if(reason.begin(), reason.end(), [](unsigned char c) { return c < ' '; }, ' ');
        throw InputError(place(file, e.source()) + reason);
    } catch (const ParserIsLost&) {
        throw InputError(file + ":" + std::to_string(line_of_no_return(text.str(), file)) + ":1: is not TOML");
    }
}

void TomlSection::fail(const toml::node& node, const std::string& reason) const {
    throw InputError(place(file_, node.source()) + reason);
}

const toml::node* TomlSection::find(std::string_view key) {
    known_.emplace_back(key);
    return table_.get(key);
}

void TomlSection::read(std::string_view key, double& value, double lowest, double highest) {
    if (const toml::node* node = find(key)) value = number(*node, key, lowest, highest);
}

void TomlSection::read(std::string_view key, std::string& value) {
    if (const toml::node* node = find(key)) {
        const auto text = node->value<std::string>();
        if (!node->is_string() || !text) fail(*node, std::string(key) + " must be a string");
        value = *text;
    }
}

void TomlSection::read(std::string_view key, std::vector<std::string>& values) {
    const toml::node* node = find(key);
    if (!node) return;
    const auto add = [&](const toml::node& word) {
        if (!word.is_string()) fail(word, std::string(key) + " must be a string or an array of strings");
        values.push_back(*word.value<std::string>());
    };
    const toml::array* array = node->as_array();
    if (!array) return add(*node);
    for (const toml::node& word : *array) add(word);
}

void TomlSection::read(std::string_view key, bool& value) {
    if (const toml::node* node = find(key)) {
        if (!node->is_boolean()) fail(*node, std::string(key) + " must be true or false");
        value = *node->value<bool>();
    }
}

void TomlSection::read(std::string_view key, Vec3d& value) {
    if (const toml::node* node = find(key)) {
        const std::vector<double> v = numbers(*node, key, 3);
        value = Vec3d(v[0], v[1], v[2]);
    }
}

void TomlSection::read(std::string_view key, Quat& value) {
    if (const toml::node* node = find(key)) {
        const std::vector<double> v = numbers(*node, key, 4);
        const Vec3d axis(v[0], v[1], v[2]);
        if (v[3] != 0 && axis.norm() == 0) fail(*node, std::string(key) + ": the axis has no length");
        value = v[3] == 0 ? Quat{} : from_rotation_vector(axis.normalized() * (v[3] * std::numbers::pi / 180));
    }
}

bool TomlSection::read(std::string_view key, size_t count, std::vector<double>& values) {
    const toml::node* node = find(key);
    if (node) values = numbers(*node, key, count);
    return node != nullptr;
}

void TomlSection::read_direction(std::string_view key, Vec3d& direction) {
    read(key, direction);
    if (direction.norm() == 0) fail(*find(key), std::string(key) + " has no length");
    direction.normalize();
}

void TomlSection::read_counts(std::string_view key, std::array<uint32_t, 2>& value, double lowest, double highest) {
    if (const toml::node* node = find(key)) {
        const std::vector<double> v = numbers(*node, key, 2);
        for (size_t i = 0; i < 2; ++i) {
            if (v[i] < lowest || v[i] > highest || v[i] != std::floor(v[i])) fail(*node, std::string(key) + " must be two whole numbers");
            value[i] = static_cast<uint32_t>(v[i]);
        }
    }
}

const toml::array* TomlSection::tables(std::string_view key) {
    const toml::node* node = find(key);
    if (!node) return nullptr;
    const toml::array* array = node->as_array();
    if (!array || !array->is_array_of_tables())
        fail(*node, "write [[" + std::string(key) + "]] for each " + std::string(key));
    return array;
}

const toml::table* TomlSection::table(std::string_view key) {
    const toml::node* node = find(key);
    if (!node) return nullptr;
    if (!node->is_table()) fail(*node, std::string(key) + " must be a table");
    return node->as_table();
}

void TomlSection::refuse_unknown() const {
    for (const auto& [key, node] : table_) {
        const std::string word(key.str());
        if (std::find(known_.begin(), known_.end(), word) != known_.end()) continue;
        const std::string guess = nearest(word, known_);
        throw InputError(place(file_, key.source()) + "unknown key \"" + word + "\"" +
                         (name_.empty() ? "" : " in " + name_) +
                         (guess.empty() ? "" : "; did you mean \"" + guess + "\"?"));
    }
}

double TomlSection::number(const toml::node& node, std::string_view key, double lowest, double highest) const {
    if (!node.is_number()) fail(node, std::string(key) + " must be a number");
    const double d = *node.value<double>();
    if (!std::isfinite(d) || d < lowest || d > highest) {
        std::ostringstream text;
        text << key << " = " << d << " is outside " << lowest << " to " << highest;
        fail(node, text.str());
    }
    return d;
}

std::vector<double> TomlSection::numbers(const toml::node& node, std::string_view key, size_t count) const {
    const toml::array* array = node.as_array();
    if (!array || array->size() != count)
        fail(node, std::string(key) + " must be a list of " + std::to_string(count) + " numbers");
    std::vector<double> v;
    for (const toml::node& element : *array) v.push_back(number(element, key, -1e300, 1e300));
    return v;
}

}  // namespace trocar
