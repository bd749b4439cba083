#include "engine/contact_rows.hpp"

#include <algorithm>

#include "engine/parallel.hpp"
namespace trocar {

void resize_rows(ContactRows& rows, size_t count) {
    rows.contact.resize(count);
    rows.body.resize(count);
    rows.other.resize(count);
    rows.vertex.resize(count);
    rows.along.resize(count);
    rows.third.resize(count);
    rows.across.resize(count);
    rows.triangle.resize(count);
    rows.weight.resize(count);
    rows.normal.resize(count);
    rows.distance.resize(count);
    rows.friction.resize(count);
    rows.impulse.assign(count, Vec3d::Zero());
}

void take_out_rows(std::span<const uint8_t> dropped, ContactRows& rows) {
    const uint32_t count = uint32_t(rows.body.size());
    if (std::find(dropped.begin(), dropped.begin() + count, 1) == dropped.begin() + count) return;
    const auto compact = [&](auto& column) {
        uint32_t kept = 0;  // every row is copied: which ones stay cannot be predicted
        for (uint32_t row = 0; row < count; ++row) {
            column[kept] = column[row];
            kept += !dropped[row];
        }
    };
    const auto compact_column = [&](uint32_t column) {
        switch (column) {
            case 0:
                return compact(rows.contact);
            case 1:
                return compact(rows.body);
            case 2:
                return compact(rows.other);
            case 3:
                return compact(rows.vertex);
            case 4:
                return compact(rows.along);
            case 5:
                return compact(rows.third);
            case 6:
                return compact(rows.across);
            case 7:
                return compact(rows.triangle);
            case 8:
                return compact(rows.weight);
            case 9:
                return compact(rows.normal);
            case 10:
                return compact(rows.distance);
            default:
                return compact(rows.friction);
        }
    };
    constexpr uint32_t kColumns = 12, kFewRows = 1024;
    parallel_for(kColumns, count < kFewRows ? kColumns : 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t column = begin; column < end; ++column) compact_column(column);
    });
    resize_rows(rows, count - uint32_t(std::count(dropped.begin(), dropped.begin() + count, 1)));
}

}  // namespace trocar
