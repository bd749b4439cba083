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

// A text as TOML, or nothing if it is none.
std::optional<toml::table> parse_toml(std::string_view text);

// "file:line:column: ", or "file: " for what came from the command line.
std::string place(const std::string& file, const toml::source_region& source);

// The known word least edits away; empty when none is near.
std::string nearest(std::string_view word, const std::vector<std::string>& known);

// The tables of a file. Throws InputError when it cannot be read, saying that it is no `what`, or "file:line:column: reason".
toml::table read_toml(const std::filesystem::path& path, const std::string& what);

// One table being read: remembers which keys were asked for, so that the rest can be refused. Each read leaves the value
// alone when the key is not there, and throws InputError "file:line:column: reason" when it is of another kind or out of bounds.
class TomlSection {
 public:
    TomlSection(const std::string& file, const toml::table& table, std::string name) : file_(file), table_(table), name_(std::move(name)) {}

    [[noreturn]] void fail(const toml::node& node, const std::string& reason) const;
    [[noreturn]] void fail(const std::string& reason) const { fail(table_, reason); }

    const toml::node* find(std::string_view key);
    void read(std::string_view key, double& value, double lowest = -1e300, double highest = 1e300);
    void read(std::string_view key, std::string& value);
    void read(std::string_view key, std::vector<std::string>& values);  // one string, or an array of them
    void read(std::string_view key, bool& value);
    void read(std::string_view key, Vec3d& value);
    void read(std::string_view key, Quat& value);                                // [axis x, y, z, degrees]
    bool read(std::string_view key, size_t count, std::vector<double>& values);  // false when the key is not there
    void read_direction(std::string_view key, Vec3d& direction);                 // any length but none
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
    const toml::array* tables(std::string_view key);
    const toml::table* table(std::string_view key);
    // `parameters`: words that the command line could have meant besides the keys of this table.
    void refuse_unknown(const std::vector<std::string>& parameters = {}) const;
    uint32_t line() const { return table_.source().begin.line; }

 private:
    double number(const toml::node& node, std::string_view key, double lowest, double highest) const;
    std::vector<double> numbers(const toml::node& node, std::string_view key, size_t count) const;

    const std::string& file_;
    const toml::table& table_;
    std::string name_;
    std::vector<std::string> known_;
};

}  // namespace trocar
