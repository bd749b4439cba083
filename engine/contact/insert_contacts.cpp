#include "engine/contact/insert_contacts.hpp"

#include <algorithm>

#include "engine/contact/columns.hpp"
namespace trocar {

void open_rows(std::span<const uint32_t> before, Contacts& contacts) {
    if (before.empty()) return;
    each_column(contacts, contacts.pair.size(), [&](std::string_view name, auto& column) {
        if (name == "most") return;
        size_t end = column.size();
        column.resize(end + before.size());
        const auto first = column.begin();
        for (size_t i = before.size(); i-- > 0;) {
            std::copy_backward(first + before[i], first + end, first + end + i + 1);
            end = before[i];
        }
    });
}

}  // namespace trocar
