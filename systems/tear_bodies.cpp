#include "systems/tear_bodies.hpp"

#include <algorithm>
namespace trocar {

void copy_torn_springs(const Springs& springs, const Torn& torn, TornSprings& torn_springs) {
    const size_t rows = torn.spring.size();
    torn_springs.neighbour.resize(rows);
    torn_springs.rest_length.resize(rows);
    std::copy_n(springs.neighbour.begin(), rows, torn_springs.neighbour.begin());
    std::copy_n(springs.rest_length.begin(), rows, torn_springs.rest_length.begin());
    for (uint32_t prototype = 0; prototype < springs.info.size(); ++prototype) {
        const Range slices = springs.info[prototype].slices;
        const uint32_t* column = springs.slice_column.data() + slices.first + prototype;
        if (slices.count == 0 || size_t{column[slices.count]} * kSliceWidth > rows) continue;
        for (uint32_t slice = 0; slice < slices.count; ++slice) {
            for (size_t h = size_t{column[slice]} * kSliceWidth; h < size_t{column[slice + 1]} * kSliceWidth; ++h) {
                if (!torn.spring[h]) continue;
                torn_springs.neighbour[h] = slice * kSliceWidth + static_cast<uint32_t>(h % kSliceWidth);
                torn_springs.rest_length[h] = 0;
            }
        }
    }
}

}  // namespace trocar
