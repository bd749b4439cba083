#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "content/mend/admission.hpp"
#include "content/mend/clean_mesh.hpp"
#include "engine/base/error.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/files/text_file.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/geometry/space_curve.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/load_file.hpp"
#include "systems/app/console/standard_streams.hpp"
namespace trocar {
namespace {

constexpr const char* kFeatureNames[] = {"vertex0", "vertex1", "vertex2", "edge0", "edge1", "edge2", "face"};

// Format: one x,y,z per line, separated by commas, blanks, tabs or semicolons, after an optional header.
constexpr double kFarthestPoint = 1e150;  // squares of larger values overflow

// Whether a field is neither a number nor one of the words for NaN and infinity.
bool is_word(const char* p, const char* stop) {
    double value = 0;
    return p < stop && std::isalpha(static_cast<unsigned char>(*p)) && std::from_chars(p, stop, value).ec != std::errc();
}

std::vector<Vec3d> parse_points(const std::string& file, const std::string& text) {
    std::vector<Vec3d> points;
    size_t line_number = 0;
    for (size_t begin = 0; begin < text.size();) {
        const size_t end = std::min(text.find('\n', begin), text.size());
        const char* p = text.data() + begin;
        const char* stop = text.data() + end;
        begin = end + 1;
        ++line_number;
        const auto skip = [&] {
            while (p < stop && (*p == ' ' || *p == '\t' || *p == ',' || *p == ';' || *p == '\r')) ++p;
        };
        skip();
        if (p == stop || *p == '#') continue;
        Vec3d v;
        for (int k = 0; k < 3; ++k) {
            skip();
            if (p < stop && *p == '+') ++p;
            const auto [next, error] = std::from_chars(p, stop, v[k]);
            if (error != std::errc() || !(std::abs(v[k]) < kFarthestPoint)) {
                if (line_number == 1 && k == 0 && is_word(p, stop)) break;  // header
                throw InputError(file + ":" + std::to_string(line_number) + ": three numbers x,y,z are needed, finite and below 1e150");
            }
            p = next;
            if (k == 2) points.push_back(v);
        }
    }
    return points;
}

std::string to_csv(const std::vector<SurfacePoint>& answers) {
    std::string out = "distance,cx,cy,cz,triangle,feature\n";
    for (const SurfacePoint& a : answers) {
        out += format("%.17g,%.17g,%.17g,%.17g,%u,%s\n", a.distance, a.point.x(), a.point.y(), a.point.z(), a.triangle,
                      kFeatureNames[static_cast<size_t>(a.feature)]);
    }
    return out;
}

std::string to_json(const std::vector<SurfacePoint>& answers) {
    nlohmann::ordered_json rows = nlohmann::ordered_json::array();
    for (const SurfacePoint& a : answers)
        rows.push_back({{"distance", a.distance},
                        {"closest", {a.point.x(), a.point.y(), a.point.z()}},
                        {"triangle", a.triangle},
                        {"feature", kFeatureNames[static_cast<size_t>(a.feature)]}});
    return rows.dump(1) + "\n";
}

// Drops triangles with repeated corners; returns the file indices of the remaining ones.
std::vector<uint32_t> drop_repeated_corners(Mesh& mesh) {
    std::vector<uint32_t> number;
    std::vector<Triangle> kept;
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        const Triangle& c = mesh.triangle[t];
        if (c[0] == c[1] || c[1] == c[2] || c[2] == c[0]) continue;
        kept.push_back(c);
        number.push_back(t);
    }
    mesh.triangle = kept;
    mesh.uv.clear();
    mesh.triangle_material.clear();
    return number;
}

// Names a closest point that several triangles share by the lowest of them: at a corner, whose coordinates it then has,
// also where rounding calls it the end of an edge or a place of a face.
void name_by_lowest_triangle(const MeshView& mesh, SurfacePoint& answer) {
    if (answer.triangle == kNone) return;
    const Triangle& own = mesh.triangle[answer.triangle];
    const auto index_in = [](const Triangle& t, uint32_t v) { return static_cast<int>(std::ranges::find(t, v) - t.begin()); };
    for (int k = 0; k < 3; ++k) {
        if (static_cast<int>(answer.feature) != k && answer.point != mesh.position[own[k]]) continue;
        answer.point = mesh.position[own[k]];
        answer.triangle = mesh.incident[mesh.incident_first[own[k]]];
        answer.feature = static_cast<Feature>(index_in(mesh.triangle[answer.triangle], own[k]));
        return;
    }
    if (answer.feature == Feature::kFace) return;
    const int edge = static_cast<int>(answer.feature) - static_cast<int>(Feature::kEdge0);
    const uint32_t other = mesh.neighbour[answer.triangle][edge];
    if (other > answer.triangle) return;
    answer.triangle = other;
    for (int k = 0; k < 3; ++k)
        if (std::ranges::find(own, mesh.triangle[other][k]) == own.end())
            answer.feature = static_cast<Feature>(static_cast<int>(Feature::kEdge0) + (k + 1) % 3);
}

// Answers all points in spatial order, so that the data touched by one query is still cached for the next.
// Returns the number of signs on which the cross-check disagrees.
uint64_t ask(const ClosestPointTree& tree, const std::vector<Vec3d>& points, std::vector<SurfacePoint>& answers) {
    Box box;
    for (const Vec3d& p : points) box.min = box.min.cwiseMin(p), box.max = box.max.cwiseMax(p);
    std::vector<std::pair<uint64_t, uint32_t>> order(points.size());
    for (uint32_t i = 0; i < points.size(); ++i) order[i] = {hilbert_key(points[i], box), i};
    std::sort(order.begin(), order.end());
    constexpr uint32_t kGrain = 256;
    const std::vector<double> radius(kGrain, std::numeric_limits<double>::infinity());
    const uint32_t count = static_cast<uint32_t>(points.size());
    std::vector<QueryCounters> counters(chunk_count(count, kGrain));
    parallel_for(count, kGrain, [&](uint32_t begin, uint32_t end) {
        std::array<Vec3d, kGrain> point;
        std::array<SurfacePoint, kGrain> answer;
        for (uint32_t i = begin; i < end; ++i) point[i - begin] = points[order[i].second];
        tree.query(std::span(point).first(end - begin), std::span(radius).first(end - begin), {}, std::span(answer).first(end - begin),
                   counters[begin / kGrain]);
        for (uint32_t i = begin; i < end; ++i) answers[order[i].second] = answer[i - begin];
    });
    uint64_t disagreements = 0;
    for (const QueryCounters& c : counters) disagreements += c.disagreements;
    return disagreements;
}

}  // namespace

int query_command(const QueryOptions& options) {
    LoadedMesh loaded = load_file(options.mesh, options.roots);
    const std::vector<uint32_t> file_triangle = drop_repeated_corners(loaded.mesh);
    CleanReport oriented = orient_mesh(loaded.mesh);
    oriented.cavities = 0;  // cavities are oriented correctly already
    const std::string turned = describe_cleaning(oriented);
    if (!turned.empty()) std::fprintf(stderr, "trocar: warning: %s: %s\n", options.mesh.c_str(), turned.c_str());
    const MeshJudgement judgement = judge_mesh(loaded.mesh, true);
    if (judgement.admitted_as == Admission::kRefused) throw InputError(options.mesh + ": " + judgement.reason);
    if (judgement.admitted_as != Admission::kSolid)
        std::fprintf(stderr, "trocar: warning: %s: %s\n", options.mesh.c_str(), judgement.reason.c_str());
    const std::string text = options.points == "-" ? read_standard_input() : read_text_file(options.points);
    const std::vector<Vec3d> points = parse_points(options.points, text);

    Meshes meshes;
    const uint32_t prototype = add_prototype(meshes, loaded.mesh, judgement.admitted_as);
    ClosestPointTree tree(mesh_view(meshes, prototype), nullptr, options.search);
    tree.cross_check(options.cross_check);
    std::vector<SurfacePoint> answers(points.size());
    const uint64_t disagreements = ask(tree, points, answers);
    if (options.cross_check && judgement.admitted_as != Admission::kSolid)
        std::fprintf(stderr, "trocar: nothing to cross-check: the mesh is not a solid\n");
    else if (options.cross_check)
        std::fprintf(stderr, "trocar: %llu of %zu signs differ from the winding number\n", static_cast<unsigned long long>(disagreements),
                     points.size());
    for (SurfacePoint& a : answers) {
        name_by_lowest_triangle(mesh_view(meshes, prototype), a);
        if (a.triangle != kNone) a.triangle = file_triangle[a.triangle];
    }
    const std::string out = options.json ? to_json(answers) : to_csv(answers);
    if (options.out.empty())
        write_standard_output(out);
    else
        write_whole_file(options.out, out);
    return kDone;
}

}  // namespace trocar
