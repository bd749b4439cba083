#include "content/mend/weld_exact.hpp"

#include <bit>
namespace trocar {
namespace {

uint64_t mix(uint64_t h) {
    h ^= h >> 32;
    h *= 0x9e3779b97f4a7c15u;
    return h ^ (h >> 29);
}

uint64_t hash_position(const Vec3d& p) {
    uint64_t h = 0;
    for (int k = 0; k < 3; ++k) h = mix(h + std::bit_cast<uint64_t>(p[k] + 0.0));  // + 0.0 makes -0 equal to 0
    return h;
}

}  // namespace

uint32_t weld_exact(Mesh& mesh) {
    const size_t count = mesh.position.size();
    std::vector<uint32_t> renamed(count, kNone);
    for (const Triangle& t : mesh.triangle) {
        for (const uint32_t v : t) renamed[v] = 0;
    }
    // open addressing with load at most one half; slots hold new vertex indices
    const size_t slots = std::bit_ceil(2 * count + 2);
    std::vector<uint32_t> slot(slots, kNone);
    uint32_t kept = 0, joined = 0;
    for (size_t v = 0; v < count; ++v) {
        if (renamed[v] == kNone) continue;
        const Vec3d p = mesh.position[v];
        size_t s = hash_position(p) & (slots - 1);
        while (slot[s] != kNone && mesh.position[slot[s]] != p) s = (s + 1) & (slots - 1);
        if (slot[s] == kNone) {
            slot[s] = kept;
            mesh.position[kept++] = p;
        } else {
            ++joined;
        }
        renamed[v] = slot[s];
    }
    mesh.position.resize(kept);
    for (Triangle& t : mesh.triangle) {
        for (uint32_t& v : t) v = renamed[v];
    }
    return joined;
}

}  // namespace trocar
