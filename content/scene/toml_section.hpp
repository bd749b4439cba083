#pragma once
#include <toml++/toml.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "components/math.hpp"
namespace trocar {

// Parses a text as TOML; nullopt if it is invalid.
std::optional<toml::table> parse_toml(std::string_view text);

// "file:line:column: ", or "file: " for values from the command line.
std::string location(const std::string& file, const toml::source_region& source);

// The known word with the smallest edit distance; empty if none is close.
std::string nearest(std::string_view word, const std::vector<std::string>& known);

// Parses a TOML file. Throws InputError: that it is not a `what`, if unreadable, or "file:line:column:
// reason".
toml::table read_toml(const std::filesystem::path& path, const std::string& what);

// The same for a text, which errors call `file`.
toml::table read_toml_text(const std::string& text, const std::string& file);

// One table being read. It records which keys were read, so that unknown ones can be rejected. A read of an
// absent key keeps the value; a wrong type or range throws InputError "file:line:column: reason".
class TomlSection {
 public:
    // `name` as in errors: "[contact]", "[[body]]"; empty for the whole file.
    TomlSection(const std::string& file, const toml::table& table, std::string name = "")
        : file_(file), table_(table), name_(std::move(name)) {}

    [[noreturn]] void fail(const toml::node& node, const std::string& reason) const;
    [[noreturn]] void fail(const std::string& reason) const { fail(table_, reason); }

    const toml::node* find(std::string_view key);
    void read(std::string_view key, double& value, double lowest = -1e300, double highest = 1e300);
    void read(std::string_view key, std::string& value);
    void read(std::string_view key, std::vector<std::string>& values);  // one string or an array of strings
    void read(std::string_view key, bool& value);
    void read(std::string_view key, Vec3d& value);
    void read(std::string_view key, Quat& value);                                // [axis x, y, z, degrees]
    bool read(std::string_view key, size_t count, std::vector<double>& values);  // false if the key is absent
    void read_direction(std::string_view key, Vec3d& direction);                 // any length except 0
    void read_counts(std::string_view key, std::array<uint32_t, 2>& value, double lowest, double highest);
    template <typename Int>
    void read_count(std::string_view key, Int& value, double lowest, double highest) {
        double d = static_cast<double>(value);
        if (const toml::node* node = find(key)) {
            d = number(*node, key, lowest, highest);
            if (d != std::floor(d)) fail(*node, std::string(key) + " must be a whole number");
            value = static_cast<Int>(d);
        }
    }
    template <typename Enum>
    void read_enum(std::string_view key, Enum& value, const std::vector<std::pair<std::string, Enum>>& names) {
        std::string text;
        read(key, text);
        if (text.empty()) return;
        std::string list;
        for (const auto& [word, e] : names) {
            if (word == text) {
                value = e;
                return;
            }
            list += (list.empty() ? "" : ", ") + word;
        }
        fail(*table_.get(key), std::string(key) + " \"" + text + "\" is none of " + list);
    }
    const toml::table* table(std::string_view key);
    // Reads a table, or each table of a list, as a section of its own: T read_one(TomlSection).
    template <typename T, typename Read>
    void read_table(std::string_view key, T& value, const Read& read_one) {
        if (const toml::table* inner = table(key)) value = read_one({file_, *inner, name_below("[", key, "]")});
    }
    template <typename T, typename Read>
    void read_list(std::string_view key, std::vector<T>& list, const Read& read_one) {
        const toml::array* array = tables(key);
        for (size_t i = 0; array && i < array->size(); ++i)
            list.push_back(read_one({file_, *array->get_as<toml::table>(i), name_below("[[", key, "]]")}));
    }
    // `parameters`: further words to suggest for an unknown key from the command line.
    void refuse_unknown(const std::vector<std::string>& parameters = {}) const;
    uint32_t line() const { return table_.source().begin.line; }

 private:
    const toml::array* tables(std::string_view key);
    std::string name_below(const char* open, std::string_view key, const char* close) const;
    double number(const toml::node& node, std::string_view key, double lowest, double highest) const;
    std::vector<double> numbers(const toml::node& node, std::string_view key, size_t count) const;

    const std::string& file_;
    const toml::table& table_;
    std::string name_;
    std::vector<std::string> known_;
};

}  // namespace trocar
