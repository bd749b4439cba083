#include "content/scene/tissue_regions.hpp"

#include <algorithm>

#include "content/read/ply_file.hpp"
#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "engine/tissue/deformable_setup.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

void vary_springs(const std::vector<double>& stiffness, uint32_t prototype, Springs& springs) {
    SpringInfo& info = springs.info[prototype];
    const uint32_t* column = springs.slice_column.data() + info.slices.first + prototype;
    if (!info.varied) springs.factor.resize(std::max(springs.factor.size(), size_t{column[info.slices.count]} * kSliceWidth), 1.0f);
    info.varied = 1;
    for (uint32_t slice = 0; slice < info.slices.count; ++slice) {
        for (size_t h = size_t{column[slice]} * kSliceWidth; h < size_t{column[slice + 1]} * kSliceWidth; ++h) {
            const uint32_t from = slice * kSliceWidth + static_cast<uint32_t>(h % kSliceWidth), to = springs.neighbour[h];
            if (to == from) continue;
            springs.factor[h] = static_cast<float>(double{springs.factor[h]} * 0.5 * (stiffness[from] + stiffness[to]));
        }
    }
}

void vary_hinges(const std::vector<double>& stiffness, uint32_t prototype, Hinges& hinges) {
    if (prototype >= hinges.groups.size()) return;
    const Range groups = hinges.groups[prototype];
    for (uint32_t g = groups.first; g < groups.end(); ++g) {
        for (uint32_t lane = 0; lane < 8; ++lane) {
            const uint32_t from = hinges.vertex[size_t{32} * g + lane], to = hinges.vertex[size_t{32} * g + 8 + lane];
            float& weight = hinges.weight[size_t{8} * g + lane];
            weight = static_cast<float>(double{weight} * 0.5 * (stiffness[from] + stiffness[to]));
        }
    }
}

void vary_tetrahedra(const std::vector<double>& stiffness, uint32_t prototype, Solids& solids) {
    SolidInfo& info = solids.info[prototype];
    info.varied = 1;
    solids.factor.resize(std::max<size_t>(solids.factor.size(), info.tetrahedra.end()), 1.0f);
    for (uint32_t t = info.tetrahedra.first; t < info.tetrahedra.first + info.count; ++t) {
        double sum = 0;
        for (const auto& corner : solids.corner) sum += 0.25 * stiffness[corner[t]];
        solids.factor[t] *= static_cast<float>(sum);
    }
}

}  // namespace

void vary_tissue(const NodeTissue& nodes, const Meshes& meshes, uint32_t body, Springs& springs, Solids& solids, Bodies& bodies,
                 Particles& particles, Anchors& anchors) {
    const uint32_t prototype = bodies.mesh[body];
    const uint32_t skin = embedded_count(solids, prototype);
    const Range range{bodies.particles[body].first + skin, bodies.particles[body].count - skin};
    std::vector<double> stiffness = nodes.stiffness;
    const size_t count = stiffness.size();
    TROCAR_ASSERT(count <= range.count && nodes.density.size() == count && nodes.fixed.size() == count);
    stiffness.resize(range.count, 1.0);
    vary_springs(stiffness, prototype, springs);
    vary_hinges(stiffness, prototype, springs.hinges);
    for (uint32_t v = 0; v < count; ++v) {
        Float4& o = particles.offset[range.first + v];
        float& anchor = anchors.stiffness[range.first + v];
        anchor = static_cast<float>(double{anchor} * stiffness[v]);
        o.w = nodes.fixed[v] ? 0.0f : static_cast<float>(double{o.w} / nodes.density[v]);
    }
    if (is_solid(solids, prototype)) {
        vary_tetrahedra(stiffness, prototype, solids);
        update_solid_dt(meshes, springs, solids, body, particles, anchors, bodies);
    } else {
        update_stable_dt(springs, body, particles, anchors, bodies);
    }
}

PaintedField read_painted_field(const std::filesystem::path& path, const std::string& property) {
    const std::string bytes = read_file_bytes(path);
    if (!looks_like_ply(bytes)) throw InputError(path.string() + ": a painted field is a PLY file");
    PaintedField field;
    field.position = read_painted_ply(bytes, path, property, field.value).mesh.position;
    return field;
}

double value_at(const PaintedField& field, const Vec3d& position) {
    size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < field.position.size(); ++i) {
        const double d = (field.position[i] - position).squaredNorm();
        if (d < least) least = d, best = i;
    }
    return field.value[best];
}

}  // namespace trocar
