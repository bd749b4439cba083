#pragma once
#include <cstddef>
#include <string_view>
#include <type_traits>
#include <utility>
namespace trocar {

// In a struct, its members once, each followed by its unit if it has one, or by the array that it indexes:
// "index of bodies", "index of bodies or none" (kNone), for a Range "range of links"; find_fault checks those.
//     TROCAR_FIELDS(body, "index of bodies", position, "m", orientation, velocity, "m/s");
// All code that hashes, stores, reads back, empties, checks or prints the struct uses this list, in this
// order. Members to be left out (caches that affect no result) are named by TROCAR_OTHER_FIELDS. A member in
// neither list does not compile: engine/world/resources.cpp.
#define TROCAR_FIELDS(...)                            \
    template <typename Visit>                         \
    constexpr void with_fields(Visit&& visit) {       \
        visit(__VA_ARGS__);                           \
    }                                                 \
    template <typename Visit>                         \
    constexpr void with_fields(Visit&& visit) const { \
        visit(__VA_ARGS__);                           \
    }                                                 \
    static constexpr const char* kFields = #__VA_ARGS__
// The same for a struct of arrays of equal length, which find_fault checks.
#define TROCAR_COLUMNS(...)     \
    TROCAR_FIELDS(__VA_ARGS__); \
    static constexpr bool kColumns = true
#define TROCAR_OTHER_FIELDS(...) static constexpr const char* kOtherFields = #__VA_ARGS__

struct FieldName {
    std::string_view name, unit;  // unit: empty without one
};

// Takes the names from the text of a list, one after the other; an empty name at its end.
struct FieldNames {
    std::string_view rest;
    constexpr std::string_view token() {
        const size_t comma = rest.find(',');
        const std::string_view first = rest.substr(0, comma);
        rest = comma == rest.npos ? "" : rest.substr(comma + 2);  // ", "
        return first;
    }
    constexpr FieldName next() {
        FieldName field{token(), ""};
        if (!rest.empty() && rest.front() == '"') {
            field.unit = token();
            field.unit = field.unit.substr(1, field.unit.size() - 2);
        }
        return field;
    }
};

// Whether an entry of a list is a unit: a quoted text, where no struct has a member.
template <typename Entry>
constexpr bool is_unit =
    std::is_same_v<std::remove_all_extents_t<std::remove_reference_t<Entry>>, const char>&& std::is_array_v<std::remove_reference_t<Entry>>;

// visit(FieldName, member) for every field of a struct.
template <typename T, typename Visit>
constexpr void each_field(T&& t, const Visit& visit) {
    t.with_fields([&](auto&... entry) {
        FieldNames names{t.kFields};
        const auto one = [&](auto& e) {
            if constexpr (!is_unit<decltype(e)>) visit(names.next(), e);
        };
        (one(entry), ...);
    });
}

// Converts to any type, to count the members of a struct.
struct AnyValue {
    template <typename T>
    operator T() const;
};
template <typename T, size_t... i>
constexpr bool has_members(std::index_sequence<i...>) {
    return requires { T{(static_cast<void>(i), AnyValue{})...}; };
}
constexpr size_t count_names(const char* list) {
    size_t names = 0;
    for (FieldNames left{list}; !left.next().name.empty();) ++names;
    return names;
}
// Whether the lists of a struct name every member, none twice.
template <typename T>
constexpr bool lists_every_member() {
    size_t twice = 0;
    for (FieldNames left{T::kFields}; !left.rest.empty();) {
        const std::string_view name = left.next().name;
        for (FieldNames others = left; !others.rest.empty();) twice += others.next().name == name;
    }
    constexpr size_t others = [] {
        if constexpr (requires { T::kOtherFields; }) return count_names(T::kOtherFields);
        return size_t{0};
    }();
    constexpr size_t named = count_names(T::kFields) + others;
    return twice == 0 && has_members<T>(std::make_index_sequence<named>{}) && !has_members<T>(std::make_index_sequence<named + 1>{});
}

}  // namespace trocar
