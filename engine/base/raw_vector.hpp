#pragma once
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>
namespace trocar {

// Leaves new elements uninitialised.
template <typename Row>
struct RawAllocator : std::allocator<Row> {
    // such an element may contain any bytes until it is written
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

// For many megabytes of elements that are written before they are read: each page is first touched by the
// thread that writes it. Clearing them would take one thread, and fresh pages cost more than the work.
template <typename Row>
using RawVector = std::vector<Row, RawAllocator<Row>>;

}  // namespace trocar
