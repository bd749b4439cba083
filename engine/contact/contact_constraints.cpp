#include "engine/contact/contact_constraints.hpp"

#include <algorithm>

#include "engine/jobs/parallel.hpp"
namespace trocar {

void resize_constraints(ContactConstraints& constraints, size_t count) {
    constraints.contact.resize(count);
    constraints.body.resize(count);
    constraints.other.resize(count);
    constraints.vertex.resize(count);
    constraints.along.resize(count);
    constraints.third.resize(count);
    constraints.across.resize(count);
    constraints.triangle.resize(count);
    constraints.weight.resize(count);
    constraints.normal.resize(count);
    constraints.distance.resize(count);
    constraints.friction.resize(count);
    constraints.impulse.assign(count, Vec3d::Zero());
}

void remove_constraints(std::span<const uint8_t> dropped, ContactConstraints& constraints) {
    const uint32_t count = uint32_t(constraints.body.size());
    if (std::find(dropped.begin(), dropped.begin() + count, 1) == dropped.begin() + count) return;
    const auto compact = [&](auto& column) {
        uint32_t kept = 0;  // branchless: every element is copied, because which ones stay cannot be predicted
        for (uint32_t constraint = 0; constraint < count; ++constraint) {
            column[kept] = column[constraint];
            kept += !dropped[constraint];
        }
    };
    const auto compact_column = [&](uint32_t column) {
        switch (column) {
            case 0:
                return compact(constraints.contact);
            case 1:
                return compact(constraints.body);
            case 2:
                return compact(constraints.other);
            case 3:
                return compact(constraints.vertex);
            case 4:
                return compact(constraints.along);
            case 5:
                return compact(constraints.third);
            case 6:
                return compact(constraints.across);
            case 7:
                return compact(constraints.triangle);
            case 8:
                return compact(constraints.weight);
            case 9:
                return compact(constraints.normal);
            case 10:
                return compact(constraints.distance);
            default:
                return compact(constraints.friction);
        }
    };
    constexpr uint32_t kColumns = 12, kFewRows = 1024;
    parallel_for(kColumns, count < kFewRows ? kColumns : 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t column = begin; column < end; ++column) compact_column(column);
    });
    resize_constraints(constraints, count - uint32_t(std::count(dropped.begin(), dropped.begin() + count, 1)));
}

}  // namespace trocar
