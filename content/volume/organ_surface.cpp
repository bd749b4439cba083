#include "content/volume/organ_surface.hpp"

#include <meshoptimizer.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numeric>

#include "content/mend/clean_mesh.hpp"
#include "content/mend/mesh_box.hpp"
#include "content/mend/remeshing.hpp"
#include "content/mend/smoothing.hpp"
#include "content/volume/marching_cubes.hpp"
#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/geometry/edge_table.hpp"
#include "engine/mesh/mesh_topology.hpp"
namespace trocar {
namespace {

std::vector<float> gaussian(double sigma) {
    const int radius = static_cast<int>(std::ceil(3 * sigma));
    std::vector<double> weight;
    for (int i = -radius; i <= radius; ++i) weight.push_back(sigma > 0 ? std::exp(-0.5 * i * i / (sigma * sigma)) : 1);
    const double sum = std::accumulate(weight.begin(), weight.end(), 0.0);
    std::vector<float> kernel;
    for (const double w : weight) kernel.push_back(static_cast<float>(w / sum));
    return kernel;
}

// Applies a separable filter along the axis whose samples are `stride` apart. Processes `stride` adjacent
// samples together, so that memory is read in order; samples beyond the ends are zero.
void blur_axis(const std::vector<float>& kernel, size_t stride, size_t length, std::vector<float>& values) {
    const ptrdiff_t radius = static_cast<ptrdiff_t>(kernel.size() / 2);
    std::vector<float> block(stride * length);
    for (size_t base = 0; base < values.size(); base += stride * length) {
        std::fill(block.begin(), block.end(), 0.0f);
        for (ptrdiff_t i = 0; i < ptrdiff_t(length); ++i) {
            float* to = block.data() + size_t(i) * stride;
            for (ptrdiff_t k = std::max(-radius, -i); k <= std::min(radius, ptrdiff_t(length) - 1 - i); ++k) {
                const float* from = values.data() + base + size_t(i + k) * stride;
                const float w = kernel[size_t(k + radius)];
                for (size_t s = 0; s < stride; ++s) to[s] += w * from[s];
            }
        }
        std::copy(block.begin(), block.end(), values.begin() + ptrdiff_t(base));
    }
}

// The blurred mask, negative inside, on the voxel indices of the volume.
ScalarGrid blurred_mask(const VoxelMask& mask, double sigma) {
    ScalarGrid grid;
    grid.origin = Vec3d(double(mask.first[0]), double(mask.first[1]), double(mask.first[2]));
    grid.nx = mask.size[0], grid.ny = mask.size[1], grid.nz = mask.size[2];
    grid.values.reserve(mask.inside.size());
    for (const uint8_t inside : mask.inside) grid.values.push_back(inside ? -1.0f : 0.0f);
    const std::vector<float> kernel = gaussian(sigma);
    if (kernel.size() > 1) {
        blur_axis(kernel, 1, grid.nx, grid.values);
        blur_axis(kernel, grid.nx, grid.ny, grid.values);
        blur_axis(kernel, size_t(grid.nx) * grid.ny, grid.nz, grid.values);
    }
    return grid;
}

double enclosed_volume(const Mesh& mesh) {
    double six = 0;
    for (const Triangle& t : mesh.triangle) {
        const Vec3d o = mesh.position[mesh.triangle[0][0]];
        const Vec3d a = mesh.position[t[0]] - o, b = mesh.position[t[1]] - o, c = mesh.position[t[2]] - o;
        six += a.x() * (b.y() * c.z() - b.z() * c.y()) + a.y() * (b.z() * c.x() - b.x() * c.z()) + a.z() * (b.x() * c.y() - b.y() * c.x());
    }
    return six / 6;
}

// The contour that encloses a volume of `wanted` cells: regula falsi (Illinois) on the level, to 1e-4.
Mesh contour_of_volume(const ScalarGrid& grid, double wanted) {
    // at the outer level nearly everything touched by the blur is inside, at the inner level nearly nothing
    double outer = -0.02, inner = -0.98;
    Mesh mesh = contour(grid, -0.5);
    double miss = enclosed_volume(mesh) - wanted;
    double outer_miss = miss > 0 ? 0 : enclosed_volume(contour(grid, outer)) - wanted;
    double inner_miss = miss > 0 ? -wanted : 0;
    (miss > 0 ? outer : inner) = -0.5;
    (miss > 0 ? outer_miss : inner_miss) = miss;
    for (int i = 0, side = 0; i < 20 && std::abs(miss) > 1e-4 * wanted && outer_miss > 0; ++i) {
        const double level = outer + (inner - outer) * outer_miss / (outer_miss - inner_miss);
        mesh = contour(grid, level);
        miss = enclosed_volume(mesh) - wanted;
        if (miss > 0) {
            outer = level, outer_miss = miss;
            if (side == 1) inner_miss /= 2;
            side = 1;
        } else {
            inner = level, inner_miss = miss;
            if (side == -1) outer_miss /= 2;
            side = -1;
        }
    }
    return mesh;
}

uint64_t count_open_edges(const Mesh& mesh) {
    const EdgeTable table = make_edge_table(mesh.triangle, static_cast<uint32_t>(mesh.position.size()));
    uint64_t open = 0;
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        const auto users = table.users(e);
        const bool pair = users.size() == 2 && half_edge_start(mesh.triangle, users[0]) != half_edge_start(mesh.triangle, users[1]);
        open += pair ? 0 : 1;
    }
    return open;
}

// Blurring can split thin necks: keeps the closed piece of largest volume and its cavities. Returns the
// number of outer pieces dropped.
uint32_t keep_largest_surface(Mesh& mesh) {
    const EdgeTable table = make_edge_table(mesh.triangle, static_cast<uint32_t>(mesh.position.size()));
    std::vector<uint32_t> piece;
    const uint32_t pieces = number_pieces(table, static_cast<uint32_t>(mesh.triangle.size()), piece);
    if (pieces <= 1) return 0;
    std::vector<Mesh> part(pieces);
    for (size_t t = 0; t < mesh.triangle.size(); ++t) part[piece[t]].triangle.push_back(mesh.triangle[t]);
    uint32_t best = 0, outer = 0;
    std::vector<double> volume;
    for (uint32_t p = 0; p < pieces; ++p) {
        part[p].position.swap(mesh.position);
        volume.push_back(enclosed_volume(part[p]));
        part[p].position.swap(mesh.position);
        outer += volume[p] > 0 ? 1 : 0;
        if (volume[p] > volume[best]) best = p;
    }
    if (outer <= 1) return 0;
    // a cavity belongs to the piece whose box contains it; split-off crumbs cannot contain one of the main
    // piece
    const Box main = box_of_faces(mesh, part[best].triangle);
    mesh.triangle = part[best].triangle;
    for (uint32_t p = 0; p < pieces; ++p) {
        const Box box = box_of_faces(mesh, part[p].triangle);
        const bool held = (box.min.array() > main.min.array()).all() && (box.max.array() < main.max.array()).all();
        if (volume[p] < 0 && held) {
            mesh.triangle.insert(mesh.triangle.end(), part[p].triangle.begin(), part[p].triangle.end());
        }
    }
    drop_unused_vertices(mesh);
    return outer - 1;
}

// Drops pairs of triangles with the same corners and opposite orientation, which remain when the simplifier
// collapses a sliver. The surface stays closed. Returns the number of pairs.
uint32_t drop_fins(Mesh& mesh) {
    std::map<Triangle, uint32_t> seen;
    std::vector<uint8_t> gone(mesh.triangle.size(), 0);
    uint32_t pairs = 0;
    const auto is_even = [](const Triangle& t, const Triangle& sorted) {
        const size_t k = size_t(std::find(t.begin(), t.end(), sorted[0]) - t.begin());
        return t[(k + 1) % 3] == sorted[1];
    };
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        Triangle sorted = mesh.triangle[t];
        std::sort(sorted.begin(), sorted.end());
        const auto [found, fresh] = seen.try_emplace(sorted, t);
        if (fresh || is_even(mesh.triangle[t], sorted) == is_even(mesh.triangle[found->second], sorted)) continue;
        gone[t] = gone[found->second] = 1;
        seen.erase(found);
        ++pairs;
    }
    uint32_t kept = 0;
    for (uint32_t t = 0; t < gone.size(); ++t) {
        if (!gone[t]) mesh.triangle[kept++] = mesh.triangle[t];
    }
    mesh.triangle.resize(kept);
    return pairs;
}

// Remeshes to fewer, even triangles with all vertices on the original surface.
void remesh_on_itself(Mesh& mesh, uint32_t triangles) {
    Meshes meshes;
    const uint32_t row = add_prototype(meshes, mesh, Admission::kSolid);
    const ClosestPointTree tree(mesh_view(meshes, row));
    remesh_evenly(
        {triangles}, [&](const Vec3d& p) { return tree.query(p).point; }, mesh.position, mesh.triangle);
}

std::string percent(double part) {
    char text[32];
    std::snprintf(text, sizeof text, "%.2f %%", 100 * part);
    return text;
}

// The pipeline's working state.
struct OrganWork {
    OrganSurface organ;
    const OrganProgress& progress;

    void begin(double done, const std::string& stage) const {
        if (progress) progress(done, stage);
    }
    void end(const std::string& name) {
        OrganStage stage{name, organ.mesh.triangle.size(), count_open_edges(organ.mesh), enclosed_volume(organ.mesh), 0};
        const double before = organ.stages.empty() ? organ.voxel_volume : organ.stages.back().volume;
        stage.change = stage.volume / before - 1;
        organ.stages.push_back(stage);
    }

    // Smooths. A mesh of very few triangles would shrink to nothing and is left unchanged.
    void smooth(uint32_t rounds, double wanted) {
        const std::vector<Vec3d> before = organ.mesh.position;
        smooth_taubin({rounds}, organ.mesh.triangle, organ.mesh.position);
        const double change = enclosed_volume(organ.mesh) / wanted - 1;
        if (!(std::abs(change) < 0.2)) {
            organ.warnings.push_back("smoothing was left out: it would change the volume by " + percent(change));
            organ.mesh.position = before;
            return;
        }
        if (std::abs(change) > 0.01) organ.warnings.push_back("smoothing changed the volume by " + percent(change));
        end("smoothing");
        restore_volume(wanted, organ.mesh.triangle, organ.mesh.position);
        end("volume restored");
    }

    // The simplifier judges each collapse separately and occasionally leaves a fold. Retries with one per
    // cent fewer triangles at a time; if none of these is solid, with more.
    void simplify(uint32_t triangles, bool even, double wanted) {
        const OrganSurface before = organ;
        const auto attempt = [&](uint32_t count) {
            OrganWork work{before, progress};
            even ? remesh_on_itself(work.organ.mesh, count) : void(simplify_mesh(work.organ.mesh, count));
            work.end("simplification");
            restore_volume(wanted, work.organ.mesh.triangle, work.organ.mesh.position);
            work.end("volume restored");
            work.organ.judgement = judge_mesh(work.organ.mesh);
            organ = std::move(work.organ);
            return organ.judgement.admitted_as == Admission::kSolid;
        };
        for (uint32_t k = 0; k < 10; ++k) {
            if (attempt(triangles - triangles * k / 100)) return;
        }
        for (uint32_t more = triangles; more < before.mesh.triangle.size();) {
            more += more / 4 + 1;
            if (!attempt(more)) continue;
            organ.warnings.push_back("no sound surface of " + std::to_string(triangles) + " triangles was found: it has " +
                                     std::to_string(organ.mesh.triangle.size()));
            return;
        }
    }
};

}  // namespace

uint32_t organ_frame(const OrganParams& params) { return 1 + static_cast<uint32_t>(std::ceil(3 * params.blur)); }

double simplify_mesh(Mesh& mesh, uint32_t triangles) {
    if (mesh.triangle.size() <= triangles) return 0;
    const Vec3d base = mesh.position[mesh.triangle[0][0]];
    std::vector<float> points;
    for (const Vec3d& p : mesh.position) {
        for (int c = 0; c < 3; ++c) points.push_back(static_cast<float>(p[c] - base[c]));
    }
    std::vector<uint32_t> index, kept(3 * mesh.triangle.size());
    for (const Triangle& t : mesh.triangle) index.insert(index.end(), t.begin(), t.end());
    float error = 0;
    const size_t count = meshopt_simplify(kept.data(), index.data(), index.size(), points.data(), mesh.position.size(), 3 * sizeof(float),
                                          size_t(triangles) * 3, 1.0f, 0, &error);
    mesh.triangle.clear();
    for (size_t i = 0; i < count; i += 3) mesh.triangle.push_back({kept[i], kept[i + 1], kept[i + 2]});
    while (drop_fins(mesh) > 0) {
    }
    drop_unused_vertices(mesh);
    return error;
}

OrganSurface make_organ_surface(const OrganParams& params, const Volume& volume, VoxelMask mask, const OrganProgress& progress) {
    TROCAR_ASSERT(mask.count > 0);
    OrganWork work{{}, progress};
    OrganSurface& organ = work.organ;
    organ.voxels_selected = mask.count;
    work.begin(0, "connecting voxels");
    if (!params.all_pieces) {
        organ.pieces = keep_largest_piece(mask);
        const double lost = 1 - double(mask.count) / double(organ.voxels_selected);
        if (lost > 0.01) {
            organ.warnings.push_back(percent(lost) + " of the voxels lie in " + std::to_string(organ.pieces.size() - 1) +
                                     " smaller pieces that were dropped");
        }
    }
    organ.voxels_kept = mask.count;
    organ.voxel_volume = double(mask.count) * voxel_volume(volume);
    work.begin(0.1, "contouring");
    organ.mesh = contour_of_volume(blurred_mask(mask, params.blur), double(mask.count));
    if (!params.all_pieces) {
        const uint32_t torn = keep_largest_surface(organ.mesh);
        if (torn > 0) {
            organ.warnings.push_back(std::to_string(torn) + " crumbs came off at necks thinner than a voxel and were dropped");
        }
    }
    if (organ.mesh.triangle.empty()) throw InputError("nothing is left of " + std::to_string(mask.count) + " voxels");
    for (Vec3d& p : organ.mesh.position) p = place_of_index(volume, p);
    if (signed_voxel_volume(volume) < 0) {
        for (Triangle& t : organ.mesh.triangle) std::swap(t[1], t[2]);
    }
    work.end("contour");
    const double wanted = organ.stages.back().volume;
    if (params.smooth > 0) {
        work.begin(0.4, "smoothing");
        work.smooth(params.smooth, wanted);
    }
    if (params.triangles > 0 && organ.mesh.triangle.size() > params.triangles) {
        work.begin(0.6, "simplifying");
        work.simplify(params.triangles, params.even, wanted);
    } else {
        work.begin(0.8, "judging");
        organ.judgement = judge_mesh(organ.mesh);
    }
    if (organ.judgement.admitted_as != Admission::kSolid) organ.warnings.push_back("not fit as a solid: " + organ.judgement.reason);
    return std::move(organ);
}

}  // namespace trocar
