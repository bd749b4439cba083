#include "engine/contact/contact_constraints.hpp"

#include <algorithm>

#include "engine/contact/columns.hpp"
namespace trocar {

void resize_constraints(ContactConstraints& constraints, size_t count) {
    each_field(constraints, [&](const FieldName& field, auto& column) {
        if (field.name != "warm_start") column.resize(count);
    });
    constraints.impulse.assign(count, Vec3d::Zero());
}

void remove_constraints(std::span<const uint8_t> dropped, ContactConstraints& constraints) {
    const uint32_t count = uint32_t(constraints.body.size());
    if (std::find(dropped.begin(), dropped.begin() + count, 1) == dropped.begin() + count) return;
    each_column(constraints, count, [&](std::string_view name, auto& column) {
        if (name == "impulse" || name == "warm_start") return;  // written later
        uint32_t kept = 0;  // branchless: every element is copied, because which ones stay cannot be predicted
        for (uint32_t constraint = 0; constraint < count; ++constraint) {
            column[kept] = column[constraint];
            kept += !dropped[constraint];
        }
    });
    resize_constraints(constraints, count - uint32_t(std::count(dropped.begin(), dropped.begin() + count, 1)));
}

}  // namespace trocar
