// Rates and errors of the content module, in processor time of one thread: marching cubes (voxels/s) and
// isosurface stuffing (tets/s) with the volume error and the Hausdorff distance of the surface to the shape
// (largest over corners, edge midpoints and face centres, in cells); reading speed (MB/s) against assimp and
// Coin, if built in. Benchmarks are interleaved randomly; use --benchmark_repetitions for medians.
#include <benchmark/benchmark.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>

#include "bench/suites.hpp"
#include "content/read/load_mesh.hpp"
#include "content/shapes/implicit_shapes.hpp"
#include "content/shapes/shape_library.hpp"
#include "content/volume/isosurface_stuffing.hpp"
#include "content/volume/marching_cubes.hpp"
#include "content/volume/mesh_distance.hpp"
#include "content/write/save_mesh.hpp"
#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#ifdef TROCAR_WITH_ASSIMP
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#endif
#ifdef TROCAR_WITH_COIN
#include <Inventor/SoDB.h>
#include <Inventor/SoInteraction.h>
#include <Inventor/SoPrimitiveVertex.h>
#include <Inventor/actions/SoCallbackAction.h>
#include <Inventor/nodes/SoSeparator.h>
#endif

namespace trocar {
namespace {

double enclosed_volume(std::span<const Vec3d> position, std::span<const Triangle> triangles) {
    double six = 0;
    for (const Triangle& t : triangles) {
        const Vec3d &a = position[t[0]], &b = position[t[1]], &c = position[t[2]];
        six += a.x() * (b.y() * c.z() - b.z() * c.y()) + a.y() * (b.z() * c.x() - b.x() * c.z()) + a.z() * (b.x() * c.y() - b.y() * c.x());
    }
    return six / 6;
}

double hausdorff(const ImplicitShape& shape, std::span<const Vec3d> position, std::span<const Triangle> triangles) {
    double worst = 0;
    const auto look = [&](const Vec3d& p) { worst = std::max(worst, std::abs(shape.distance(p))); };
    for (const Triangle& t : triangles) {
        const Vec3d &a = position[t[0]], &b = position[t[1]], &c = position[t[2]];
        look(a), look(b), look(c);
        look((a + b) / 2), look((b + c) / 2), look((c + a) / 2), look((a + b + c) / 3);
    }
    return worst;
}

struct Subject {
    ImplicitShape shape;
    double volume = 0;  // m^3: closed form, or from a contour on cells of 0.5 mm
};

const Subject& sphere() {
    static const Subject subject{{"sphere",
                                  {Vec3d::Constant(-0.09), Vec3d::Constant(0.09)},
                                  1,
                                  [](const Vec3d& p) { return (p - Vec3d(0.0011, 0.0007, -0.0003)).norm() - 0.08; }},
                                 4.0 / 3 * M_PI * 0.08 * 0.08 * 0.08};
    return subject;
}
const Subject& liver() {
    static const Subject subject = [] {
        Subject s{liver_shape(1), 0};
        const Mesh fine = contour(sample_shape(s.shape, 5e-4), 0);
        s.volume = enclosed_volume(fine.position, fine.triangle);
        return s;
    }();
    return subject;
}

void run_contour(benchmark::State& state, const Subject& subject, double cell) {
    const ScalarGrid grid = sample_shape(subject.shape, cell);
    Mesh mesh;
    for (auto _ : state) mesh = contour(grid, 0);
    state.counters["voxels/s"] = benchmark::Counter(double(grid.values.size()), benchmark::Counter::kIsIterationInvariantRate);
    state.counters["triangles"] = double(mesh.triangle.size());
    state.counters["volume_error_%"] = 100 * (enclosed_volume(mesh.position, mesh.triangle) / subject.volume - 1);
    state.counters["hausdorff_cells"] = hausdorff(subject.shape, mesh.position, mesh.triangle) / cell;
}

void run_stuffing(benchmark::State& state, const Subject& subject, double cell) {
    const DistanceField field = [&](std::span<const Vec3d> points, std::span<double> distance) {
        for (size_t i = 0; i < points.size(); ++i) distance[i] = subject.shape.distance(points[i]);
    };
    TetMesh mesh;
    for (auto _ : state) mesh = stuff_isosurface({cell, subject.shape.steepness}, subject.shape.box, field);
    const std::vector<Triangle> surface = boundary_of(mesh);
    const TetFacts facts = judge_tets(mesh);
    state.counters["tets/s"] = benchmark::Counter(double(mesh.tetrahedron.size()), benchmark::Counter::kIsIterationInvariantRate);
    state.counters["tets"] = double(mesh.tetrahedron.size());
    state.counters["volume_error_%"] = 100 * (facts.volume / subject.volume - 1);
    state.counters["hausdorff_cells"] = hausdorff(subject.shape, mesh.position, surface) / cell;
    state.counters["min_dihedral"] = facts.min_dihedral;
    state.counters["max_dihedral"] = facts.max_dihedral;
}

// The same liver in each format, written once into a folder of this process.
class MeshFiles {
 public:
    explicit MeshFiles(uint32_t triangles) {
        folder_ = std::filesystem::temp_directory_path() / ("trocar_content_bench_" + std::to_string(::getpid()));
        std::filesystem::create_directories(folder_);
        Mesh mesh = make_shape("liver", triangles);
        mesh.material.clear();
        for (const char* name : {"liver.obj", "liver.stl", "liver.ply", "liver.wrl"}) save_mesh(mesh, folder_ / name);
    }
    ~MeshFiles() {
        std::error_code ignored;
        std::filesystem::remove_all(folder_, ignored);
    }
    std::string path(const std::string& name) const { return (folder_ / name).string(); }

 private:
    std::filesystem::path folder_;
};

void finish_reading(benchmark::State& state, const std::string& path, size_t triangles) {
    state.counters["MB/s"] =
        benchmark::Counter(double(std::filesystem::file_size(path)) * 1e-6, benchmark::Counter::kIsIterationInvariantRate);
    state.counters["triangles"] = double(triangles);
}

void read_ours(benchmark::State& state, const std::string& path) {
    size_t triangles = 0;
    try {
        for (auto _ : state) triangles = load_mesh(path).mesh.triangle.size();
    } catch (const InputError& error) {
        state.SkipWithError(error.what());
        return;
    }
    finish_reading(state, path, triangles);
}

#ifdef TROCAR_WITH_ASSIMP
void read_assimp(benchmark::State& state, const std::string& path) {
    size_t triangles = 0;
    for (auto _ : state) {
        Assimp::Importer importer;
        const aiScene* scene = importer.ReadFile(path, aiProcess_Triangulate | aiProcess_JoinIdenticalVertices);
        if (scene == nullptr) return state.SkipWithError(importer.GetErrorString());
        triangles = 0;
        for (unsigned m = 0; m < scene->mNumMeshes; ++m) triangles += scene->mMeshes[m]->mNumFaces;
    }
    finish_reading(state, path, triangles);
}
#endif

#ifdef TROCAR_WITH_COIN
void read_coin(benchmark::State& state, const std::string& path) {
    size_t triangles = 0;
    for (auto _ : state) {
        SoInput input;
        if (!input.openFile(path.c_str())) return state.SkipWithError("cannot be opened");
        SoSeparator* root = SoDB::readAll(&input);
        if (root == nullptr) return state.SkipWithError("refused");
        root->ref();
        triangles = 0;
        SoCallbackAction action;
        action.addTriangleCallback(
            SoNode::getClassTypeId(),
            [](void* count, SoCallbackAction*, const SoPrimitiveVertex*, const SoPrimitiveVertex*, const SoPrimitiveVertex*) {
                ++*static_cast<size_t*>(count);
            },
            &triangles);
        action.apply(root);
        root->unref();
    }
    finish_reading(state, path, triangles);
}
#endif

void register_all(const MeshFiles& files) {
    const auto add = [](const std::string& name, auto&& run) {
        benchmark::RegisterBenchmark(name.c_str(), run)->Unit(benchmark::kMillisecond);
    };
    for (const int cell : {2, 1}) {
        const std::string size = '/' + std::to_string(cell) + "mm";
        add("contour/sphere" + size, [=](benchmark::State& s) { run_contour(s, sphere(), cell * 1e-3); });
        add("contour/liver" + size, [=](benchmark::State& s) { run_contour(s, liver(), cell * 1e-3); });
    }
    for (const int cell : {8, 4}) {
        const std::string size = '/' + std::to_string(cell) + "mm";
        add("stuffing/sphere" + size, [=](benchmark::State& s) { run_stuffing(s, sphere(), cell * 1e-3); });
        add("stuffing/liver" + size, [=](benchmark::State& s) { run_stuffing(s, liver(), cell * 1e-3); });
    }
    for (const char* name : {"liver.wrl", "liver.obj", "liver.stl", "liver.ply"}) {
        const std::string path = files.path(name), suffix = std::string("/") + (name + 6);
        add("read" + suffix + "/trocar", [=](benchmark::State& s) { read_ours(s, path); });
#ifdef TROCAR_WITH_ASSIMP
        if (suffix != "/wrl") add("read" + suffix + "/assimp", [=](benchmark::State& s) { read_assimp(s, path); });
#endif
#ifdef TROCAR_WITH_COIN
        if (suffix == "/wrl") add("read" + suffix + "/coin", [=](benchmark::State& s) { read_coin(s, path); });
#endif
    }
}

}  // namespace
}  // namespace trocar

int content_suite(int argc, char** argv) {
    const trocar::ThreadPool one_thread(1);
#ifdef TROCAR_WITH_COIN
    SoDB::init();
    SoInteraction::init();
#endif
    std::vector<char*> arguments(argv, argv + argc);
    std::string interleave = "--benchmark_enable_random_interleaving=true";
    arguments.insert(arguments.begin() + 1, interleave.data());
    int count = static_cast<int>(arguments.size());
    arguments.push_back(nullptr);
    benchmark::Initialize(&count, arguments.data());
    if (benchmark::ReportUnrecognizedArguments(count, arguments.data())) return 2;
    const trocar::MeshFiles files(100'000);
    trocar::register_all(files);
    benchmark::RunSpecifiedBenchmarks();
    return 0;
}
