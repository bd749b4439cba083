#pragma once
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>
namespace trocar {

// Leaves new rows as the memory is.
template <typename Row>
struct RawAllocator : std::allocator<Row> {
    // the bytes of such a row may be anything until it is written
    static_assert(std::is_trivially_copyable_v<Row>);
    template <typename Other>
    struct rebind {
        using other = RawAllocator<Other>;
    };
    template <typename Other>
    void construct(Other*) noexcept {}
    template <typename Other, typename... Values>
    void construct(Other* at, Values&&... values) {
        std::construct_at(at, std::forward<Values>(values)...);
    }
};

// For rows that are written before they are read, many megabytes of them: whoever writes a row is the first to touch its page. To clear
// them would be one thread's work, and fresh pages cost more than what is done with them.
template <typename Row>
using RawVector = std::vector<Row, RawAllocator<Row>>;

}  // namespace trocar
