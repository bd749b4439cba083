#pragma once
#include "components/fields.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {

// visit(name, column) for every column of a struct of arrays, side by side where the columns are long; from the last, so that
// narrow columns end a run and no thread waits for a wide one.
template <typename Columns, typename Visit>
void each_column(Columns& columns, size_t rows, const Visit& visit) {
    constexpr uint32_t kColumns = count_names(Columns::kFields), kFewRows = 1024;
    parallel_for(kColumns, rows < kFewRows ? kColumns : 1, [&](uint32_t begin, uint32_t end) {
        uint32_t left = kColumns;
        each_field(columns, [&](const FieldName& field, auto& column) {
            if (--left >= begin && left < end) visit(field.name, column);
        });
    });
}

}  // namespace trocar
