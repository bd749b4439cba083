#include "content/mend/repair_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>

#include "content/mend/clean_mesh.hpp"
#include "content/mend/self_crossing.hpp"
#include "content/mend/slivers.hpp"
#include "content/mend/split_fans.hpp"
#include "engine/geometry/edge_table.hpp"
namespace trocar {
namespace {

constexpr double kApart = 0.02;  // of an edge: separated parts must not touch again after rounding to 32 bits

void say(RepairReport& report, uint64_t count, const char* one, const char* many, const std::string& more = "") {
    if (count > 0) report.done.push_back(std::to_string(count) + " " + (count == 1 ? one : many) + more);
}

std::string digits(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4g", value);
    return text;
}

double face_area(const Mesh& mesh, const Triangle& t) {
    const Vec3d& a = mesh.position[t[0]];
    return 0.5 * (mesh.position[t[1]] - a).cross(mesh.position[t[2]] - a).norm();
}

void clean(Mesh& mesh, double weld_tolerance, RepairReport& report) {
    const CleanReport cleaned = clean_mesh(mesh, {weld_tolerance});
    for (const std::string& line : list_cleaning(cleaned)) report.done.push_back(line);
}

void split(Mesh& mesh, RepairReport& report) {
    const SplitReport split = split_fans(mesh, kApart);
    say(report, split.halved, "edge halved to part its faces", "edges halved to part their faces");
    say(report, split.edges, "edge of three faces or more taken apart", "edges of three faces or more taken apart");
    say(report, split.vertices, "vertex added where parts touched", "vertices added where parts touched");
}

// Returns the fraction of the area that was dropped.
double keep_largest(Mesh& mesh, RepairReport& report) {
    const uint32_t faces = static_cast<uint32_t>(mesh.triangle.size());
    const EdgeTable table = make_edge_table(mesh.triangle, static_cast<uint32_t>(mesh.position.size()));
    std::vector<uint32_t> piece;
    const uint32_t pieces = number_pieces(table, faces, piece);
    if (pieces < 2) return 0;
    std::vector<double> area(pieces, 0);
    double whole = 0;
    for (uint32_t t = 0; t < faces; ++t) {
        area[piece[t]] += face_area(mesh, mesh.triangle[t]);
        whole += face_area(mesh, mesh.triangle[t]);
    }
    const auto largest = static_cast<uint32_t>(std::max_element(area.begin(), area.end()) - area.begin());
    std::vector<uint8_t> dropped(faces);
    for (uint32_t t = 0; t < faces; ++t) dropped[t] = piece[t] != largest;
    const auto count = std::count(dropped.begin(), dropped.end(), 1);
    drop_faces(mesh, dropped);
    say(report, pieces - 1, "smaller piece dropped", "smaller pieces dropped",
        " (" + std::to_string(count) + " faces, " + digits(100 * (1 - area[largest] / whole)) + " % of the area)");
    return 1 - area[largest] / whole;
}

HoleReport fill(Mesh& mesh, const RepairParams& params, RepairReport& report) {
    const HoleReport holes = fill_holes(mesh, params.holes);
    say(report, holes.filled, "hole filled", "holes filled", " with " + std::to_string(holes.faces_added) + " faces");
    return holes;
}

void drop_slivers(Mesh& mesh, const RepairParams& params, RepairReport& report) {
    const SliverReport slivers = remove_slivers(mesh, params.sliver_height);
    say(report, slivers.collapsed, "sliver with a short edge dropped", "slivers with a short edge dropped");
    say(report, slivers.flipped, "flat sliver turned into its neighbour", "flat slivers turned into their neighbours");
}

// Cuts out intersecting faces together with `rings` rings around them.
void cut_crossings(Mesh& mesh, std::vector<uint8_t> marked, uint32_t rings, RepairReport& report) {
    const auto pairs = std::count(marked.begin(), marked.end(), 1);
    for (uint32_t ring = 0; ring < rings; ++ring) {
        std::vector<uint8_t> near(mesh.position.size(), 0);
        for (size_t t = 0; t < marked.size(); ++t) {
            for (const uint32_t v : mesh.triangle[t]) near[v] |= marked[t];
        }
        for (size_t t = 0; t < marked.size(); ++t) {
            for (const uint32_t v : mesh.triangle[t]) marked[t] |= near[v];
        }
    }
    const auto cut = std::count(marked.begin(), marked.end(), 1);
    drop_faces(mesh, marked);
    say(report, static_cast<uint64_t>(cut), "face cut out", "faces cut out", ": " + std::to_string(pairs) + " of them met others");
}

void finish(RepairReport& report, const HoleReport& holes) {
    report.solid = report.after.admitted_as == Admission::kSolid;
    if (report.solid) return;
    report.reason = report.after.reason;
    if (holes.left == 0) return;
    report.reason += "; " + std::to_string(holes.left) + (holes.left == 1 ? " hole" : " holes") +
                     " beyond the limits for filling, the largest of " + std::to_string(holes.largest_edges) + " edges and " +
                     digits(holes.largest_diagonal) + " across";
}

}  // namespace

RepairReport repair_mesh(Mesh& mesh, const RepairParams& params) {
    RepairReport report;
    report.before = report.after = judge_mesh(mesh);
    HoleReport holes;
    const bool unusable = report.before.admitted_as == Admission::kRefused;
    if (unusable || report.before.admitted_as == Admission::kSolid) {
        finish(report, holes);
        return report;
    }
    clean(mesh, params.weld_tolerance, report);
    double first_area = 0, lost = 0, beside = 0;
    for (uint32_t round = 0; round <= params.rounds && !mesh.triangle.empty(); ++round) {
        split(mesh, report);
        const double dropped = keep_largest(mesh, report);
        if (round == 0) beside = dropped;  // in later rounds the loss is attributed to cutting
        if (beside > params.most_beside) break;
        holes = fill(mesh, params, report);
        drop_slivers(mesh, params, report);
        clean(mesh, 0, report);
        report.after = judge_mesh(mesh);
        if (round == 0) first_area = report.after.area;
        lost = 1 - report.after.area / first_area;
        if (lost > params.most_lost) break;
        if (report.after.admitted_as == Admission::kSolid || holes.left > 0 || round == params.rounds) break;
        if (report.after.self_crossing + report.after.self_touching >= kSelfCrossingLimit) break;
        cut_crossings(mesh, mark_self_crossings(mesh), round, report);
    }
    if (mesh.triangle.empty() || beside > params.most_beside) report.after = judge_mesh(mesh);
    finish(report, holes);
    if (beside > params.most_beside) {
        report.solid = false;
        report.reason = "the pieces beside the largest have " + digits(100 * beside) + " % of the area, and cannot be joined to it";
    } else if (lost > params.most_lost) {
        report.solid = false;
        report.reason = "cutting out the faces that cross takes " + digits(100 * lost) + " % of the area with it";
    }
    return report;
}

}  // namespace trocar
