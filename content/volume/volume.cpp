#include "content/volume/volume.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>

#include "engine/base/check.hpp"
namespace trocar {
namespace {

// Voxel values in their numeric type.
template <typename Value>
struct Voxels {
    const char* bytes;
    Value operator[](size_t i) const {
        Value value;
        std::memcpy(&value, bytes + i * sizeof value, sizeof value);
        return value;
    }
};

size_t voxel_count(const Volume& volume) { return size_t(volume.size[0]) * volume.size[1] * volume.size[2]; }

template <typename Work>
auto with_voxels(const Volume& volume, const Work& work) {
    TROCAR_ASSERT(volume.voxels.size() == voxel_count(volume) * scalar_bytes(volume.type));
    return with_scalar(volume.type, [&](auto zero) { return work(Voxels<decltype(zero)>{volume.voxels.data()}); });
}

template <typename Values, typename Chosen>
VoxelMask select(const Volume& volume, uint32_t frame, const Values& values, const Chosen& chosen) {
    TROCAR_ASSERT(frame >= 1);
    std::array<uint32_t, 3> low = volume.size, high{};
    const auto [nx, ny, nz] = volume.size;
    VoxelMask mask;
    const auto row_of = [&](uint32_t y, uint32_t z) { return (size_t(z) * ny + y) * nx; };
    for (uint32_t z = 0; z < nz; ++z) {
        for (uint32_t y = 0; y < ny; ++y) {
            const size_t row = row_of(y, z);
            uint32_t first = nx, end = 0;
            for (uint32_t x = 0; x < nx; ++x) {
                if (!chosen(values[row + x])) continue;
                first = std::min(first, x);
                end = x + 1;
                ++mask.count;
            }
            if (end == 0) continue;
            low = {std::min(low[0], first), std::min(low[1], y), std::min(low[2], z)};
            high = {std::max(high[0], end), std::max(high[1], y + 1), std::max(high[2], z + 1)};
        }
    }
    if (mask.count == 0) return mask;
    for (int k = 0; k < 3; ++k) {
        mask.first[k] = int64_t(low[k]) - frame;
        mask.size[k] = high[k] - low[k] + 2 * frame;
    }
    mask.inside.assign(size_t(mask.size[0]) * mask.size[1] * mask.size[2], 0);
    for (uint32_t z = low[2]; z < high[2]; ++z) {
        for (uint32_t y = low[1]; y < high[1]; ++y) {
            const size_t to = (size_t(z - low[2] + frame) * mask.size[1] + (y - low[1] + frame)) * mask.size[0] + frame;
            const size_t from = row_of(y, z) + low[0];
            for (uint32_t x = 0; x < high[0] - low[0]; ++x) mask.inside[to + x] = chosen(values[from + x]) ? 1 : 0;
        }
    }
    return mask;
}

}  // namespace

Volume take_layer(const Volume& volume, uint32_t layer) {
    TROCAR_ASSERT(layer < volume.layers);
    Volume one;
    one.size = volume.size;
    one.origin = volume.origin;
    one.step = volume.step;
    one.type = volume.type;
    const size_t bytes = scalar_bytes(volume.type), count = voxel_count(volume);
    one.voxels.resize(count * bytes);
    for (size_t i = 0; i < count; ++i) {
        std::memcpy(one.voxels.data() + i * bytes, volume.voxels.data() + (i * volume.layers + layer) * bytes, bytes);
    }
    return one;
}

Vec3d place_of_index(const Volume& volume, const Vec3d& index) {
    return volume.origin + index.x() * volume.step[0] + index.y() * volume.step[1] + index.z() * volume.step[2];
}

double signed_voxel_volume(const Volume& volume) {
    const auto& [a, b, c] = volume.step;
    return a.x() * (b.y() * c.z() - b.z() * c.y()) + a.y() * (b.z() * c.x() - b.x() * c.z()) + a.z() * (b.x() * c.y() - b.y() * c.x());
}

double voxel_volume(const Volume& volume) { return std::abs(signed_voxel_volume(volume)); }

std::vector<std::pair<double, uint64_t>> count_values(const Volume& volume, size_t most) {
    return with_voxels(volume, [&](const auto& values) {
        std::map<double, uint64_t> counts;
        const size_t n = voxel_count(volume);
        for (size_t i = 0; i < n && counts.size() <= most;) {
            const auto value = values[i];
            size_t end = i + 1;
            while (end < n && values[end] == value) ++end;
            if (!std::isnan(static_cast<double>(value))) counts[static_cast<double>(value)] += end - i;
            i = end;
        }
        if (counts.size() > most) counts.clear();
        return std::vector<std::pair<double, uint64_t>>(counts.begin(), counts.end());
    });
}

VoxelMask select_label(const Volume& volume, double label, uint32_t frame) {
    return with_voxels(volume, [&](const auto& values) {
        return select(volume, frame, values, [=](auto value) { return static_cast<double>(value) == label; });
    });
}

VoxelMask select_above(const Volume& volume, double threshold, uint32_t frame) {
    return with_voxels(volume, [&](const auto& values) {
        return select(volume, frame, values, [=](auto value) { return static_cast<double>(value) >= threshold; });
    });
}

std::vector<uint64_t> keep_largest_piece(VoxelMask& mask) {
    // 1 = not visited, 2 = visited; the border keeps neighbours inside the array
    const std::array<size_t, 3> step{1, mask.size[0], size_t(mask.size[0]) * mask.size[1]};
    std::vector<uint64_t> sizes;
    std::vector<size_t> largest, piece;
    for (size_t start = 0; start < mask.inside.size(); ++start) {
        if (mask.inside[start] != 1) continue;
        piece.assign(1, start);
        mask.inside[start] = 2;
        for (size_t done = 0; done < piece.size(); ++done) {
            const size_t at = piece[done];
            for (const size_t s : step) {
                for (const size_t next : {at - s, at + s}) {
                    if (mask.inside[next] != 1) continue;
                    mask.inside[next] = 2;
                    piece.push_back(next);
                }
            }
        }
        sizes.push_back(piece.size());
        if (piece.size() > largest.size()) largest.swap(piece);
    }
    std::fill(mask.inside.begin(), mask.inside.end(), uint8_t{0});
    for (const size_t at : largest) mask.inside[at] = 1;
    mask.count = largest.size();
    std::sort(sizes.begin(), sizes.end(), std::greater<>());
    return sizes;
}

}  // namespace trocar
