#include "engine/contact/insert_contacts.hpp"

#include <algorithm>

#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

template <typename Value>
void open_column(std::span<const uint32_t> before, std::vector<Value>& column) {
    size_t end = column.size();
    column.resize(end + before.size());
    const auto first = column.begin();
    for (size_t i = before.size(); i-- > 0;) {
        std::copy_backward(first + before[i], first + end, first + end + i + 1);
        end = before[i];
    }
}

}  // namespace

void open_rows(std::span<const uint32_t> before, Contacts& contacts) {
    if (before.empty()) return;
    const auto open = [&](uint32_t column) {
        switch (column) {  // the widest first, so that the last task to start is short
            case 0:
                return open_column(before, contacts.point);
            case 1:
                return open_column(before, contacts.closest);
            case 2:
                return open_column(before, contacts.normal);
            case 3:
                return open_column(before, contacts.vertex);
            case 4:
                return open_column(before, contacts.distance);
            case 5:
                return open_column(before, contacts.pair);
            case 6:
                return open_column(before, contacts.body);
            case 7:
                return open_column(before, contacts.other);
            case 8:
                return open_column(before, contacts.along);
            case 9:
                return open_column(before, contacts.third);
            case 10:
                return open_column(before, contacts.across);
            default:
                return open_column(before, contacts.triangle);
        }
    };
    constexpr uint32_t kColumns = 12, kFewRows = 1024;
    parallel_for(kColumns, contacts.pair.size() < kFewRows ? kColumns : 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t column = begin; column < end; ++column) open(column);
    });
}

}  // namespace trocar
