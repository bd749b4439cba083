#include "systems/detect/narrow/face_depth.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/subspan.hpp"
#include "engine/contact/pair_sides.hpp"
#include "engine/contact/write_contact.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

using Chunk = FaceDepthScratch::Chunk;

// Termination criteria of a search.
struct Enough {
    double tolerance;       // m, of depth
    uint32_t most_queries;  // per pair
};

// One side of one pair: the faces of `body` against the surface of `other`.
struct Side {
    uint32_t body, other;
    bool reversed;                                      // body is the pair's b
    std::span<const std::array<uint32_t, 2>> crossing;  // triangles of a and of b that may cross
    std::span<const uint32_t> screened;                 // triangles of body
    std::span<const uint32_t> near, near_triangle;      // vertices of body near other, and the nearest triangle of each
    std::span<const double> near_distance;              // m, as near
    MeshView mesh, other_mesh;
    const ClosestPointTree* tree;
    BodyPoints points;  // of body, about the origin of other
    bool turned;        // other is rigid: the search runs in its frame
    Quat turn;
    double doubtful;  // m, depth above which a sign is doubtful

    Vec3d position(uint32_t v) const { return turned ? rotate_back(turn, points.point(v)) : points.point(v); }
};

// Depth to beat, and the deepest point found beyond it.
struct Best {
    double depth;
    uint32_t queries = 0;
    FaceContact found;
};

double distance_to(const Side& side, uint32_t triangle, const Vec3d& p) {
    const Triangle& t = side.other_mesh.triangle[triangle];
    return distance_to_triangle(to_vec4(p), to_vec4(side.tree->vertex(t[0])), to_vec4(side.tree->vertex(t[1])),
                                to_vec4(side.tree->vertex(t[2])));
}

double farthest_from(const Side& side, uint32_t triangle, const FacePart& part) {
    double farthest = 0;
    for (const Vec3d& p : part.corner) farthest = std::max(farthest, distance_to(side, triangle, p));
    return farthest;
}

FacePart whole_face(const Side& side, const Chunk& c, uint32_t face) {
    FacePart part{{}, {Vec3d::UnitX(), Vec3d::UnitY(), Vec3d::UnitZ()}, std::numeric_limits<double>::infinity(), face, kNone};
    for (int k = 0; k < 3; ++k) {
        const uint32_t v = side.mesh.triangle[face][k];
        const bool known = !std::isnan(c.depth[v]);
        part.corner[k] = known ? c.position[v] : side.position(v);
        if (known) part.hint = c.nearest[v];
    }
    return part;
}

// Bounds the depth over a whole face from the known depths of its corners.
void bound_by_corners(const Side& side, const Chunk& c, double enough, FacePart& part) {
    const Triangle& t = side.mesh.triangle[part.face];
    for (int k = 0; k < 3; ++k) {
        const double depth = c.depth[t[k]];
        if (std::isnan(depth)) continue;
        const Vec3d &p = part.corner[k], &q = part.corner[(k + 1) % 3], &r = part.corner[(k + 2) % 3];
        part.bound = std::min(part.bound, depth + std::max((q - p).norm(), (r - p).norm()));
    }
    for (int k = 0; k < 3 && part.bound > enough; ++k) {
        if (std::isnan(c.depth[t[k]]) || c.nearest[t[k]] == kNone) continue;
        part.bound = std::min(part.bound, farthest_from(side, c.nearest[t[k]], part));
    }
}

SurfacePoint ask(const Side& side, const Vec3d& p, uint32_t hint) {
    const double radius = std::numeric_limits<double>::infinity();
    SurfacePoint answer;
    QueryCounters counters;
    side.tree->query({&p, 1}, {&radius, 1}, {&hint, 1}, {&answer, 1}, counters);
    if (-answer.distance > side.doubtful) side.tree->decide_side(p, answer);
    return answer;
}

bool less_deep(const FacePart& a, const FacePart& b) { return a.bound < b.bound; }

void push_part(const FacePart& part, Chunk& c) {
    c.part.push_back(part);
    std::push_heap(c.part.begin(), c.part.end(), less_deep);
}

// Queries the centre of a part, which may become the new best, and halves the part across its longest edge.
void look_and_split(const Side& side, const FacePart& part, double tolerance, Best& best, Chunk& c) {
    const Vec3d middle = (part.corner[0] + part.corner[1] + part.corner[2]) / 3;
    const SurfacePoint answer = ask(side, middle, part.hint);
    ++best.queries;
    if (-answer.distance > best.depth) {
        best.depth = -answer.distance;
        const Vec3d weight = (part.weight[0] + part.weight[1] + part.weight[2]) / 3;
        best.found = {part.face, float(weight[1]), float(weight[2]), middle, answer};
    }
    int longest = 0;
    const auto length = [&](int k) { return (part.corner[(k + 1) % 3] - part.corner[k]).squaredNorm(); };
    for (int k = 1; k < 3; ++k) longest = length(k) > length(longest) ? k : longest;
    const int next = (longest + 1) % 3;
    for (const int moved : {longest, next}) {
        FacePart half = part;
        half.hint = answer.triangle;
        half.corner[moved] = 0.5 * (part.corner[longest] + part.corner[next]);
        half.weight[moved] = 0.5 * (part.weight[longest] + part.weight[next]);
        double reach = 0;
        for (const Vec3d& p : half.corner) reach = std::max(reach, (p - middle).norm());
        half.bound = std::min(half.bound, reach - answer.distance);
        if (!(half.bound > best.depth + tolerance)) continue;
        half.bound = std::min(half.bound, farthest_from(side, answer.triangle, half));
        if (half.bound > best.depth + tolerance) push_part(half, c);
    }
}

// Empties the heap. `left`: bound of what a search that reached its query limit leaves open.
void search(const Enough& enough, const Side& side, Best& best, double& left, Chunk& c) {
    while (!c.part.empty()) {
        std::pop_heap(c.part.begin(), c.part.end(), less_deep);
        const FacePart part = c.part.back();
        c.part.pop_back();
        if (part.bound <= best.depth + enough.tolerance) break;
        if (best.queries >= enough.most_queries) {
            left = std::max(left, part.bound);
            break;
        }
        look_and_split(side, part, enough.tolerance, best, c);
    }
    c.part.clear();
}

// Depths of a side's vertices, and its edges that have a contact.
void collect_known(const Side& side, const Contacts& contacts, Range range, Chunk& c) {
    c.depth.assign(side.mesh.position.size(), std::nan(""));
    c.nearest.resize(side.mesh.position.size());
    c.position.resize(side.mesh.position.size());
    for (size_t i = 0; i < side.near.size(); ++i) {
        const uint32_t v = side.near[i];
        c.position[v] = side.position(v);
        c.depth[v] = -side.near_distance[i];
        c.nearest[v] = side.near_triangle[i];
    }
    c.edge.clear();
    for (uint32_t i = range.first; i < range.end(); ++i) {
        if (contacts.body[i] == side.body && contacts.vertex[i][0] != contacts.vertex[i][1]) c.edge.push_back(contacts.vertex[i]);
    }
}

// All corners and edges of a face are outside as far as the contacts tell.
bool is_outside(const Side& side, uint32_t face, const Chunk& c) {
    const Triangle& t = side.mesh.triangle[face];
    for (int k = 0; k < 3; ++k) {
        if (!(c.depth[t[k]] <= 0)) return false;
        const std::array<uint32_t, 2> edge{std::min(t[k], t[(k + 1) % 3]), std::max(t[k], t[(k + 1) % 3])};
        if (std::binary_search(c.edge.begin(), c.edge.end(), edge)) return false;
    }
    return true;
}

// Faces with corners and edges outside through which an edge of the other body passes.
void collect_poked(const Side& side, Chunk& c) {
    c.poked.clear();
    uint32_t face = kNone;
    bool outside = false;
    FacePart part;
    for (const std::array<uint32_t, 2>& pair : side.crossing) {
        const uint32_t own = pair[side.reversed], across = pair[!side.reversed];
        if (own != face) {
            face = own;
            outside = is_outside(side, face, c);
            if (outside) part = whole_face(side, c, face);
        }
        if (!outside || (!c.poked.empty() && c.poked.back() == own)) continue;
        const Triangle& t = side.other_mesh.triangle[across];
        const Vec4d corner[3] = {to_vec4(part.corner[0]), to_vec4(part.corner[1]), to_vec4(part.corner[2])};
        for (int k = 0; k < 3; ++k) {
            if (edge_crossing(to_vec4(side.tree->vertex(t[k])), to_vec4(side.tree->vertex(t[(k + 1) % 3])), corner[0], corner[1],
                              corner[2]) < 0)
                continue;
            c.poked.push_back(own);
            break;
        }
    }
    std::sort(c.poked.begin(), c.poked.end());
    c.poked.erase(std::unique(c.poked.begin(), c.poked.end()), c.poked.end());
}

// Stores the point given by the rounded weights.
void add_found(const Side& side, FaceContact found, Chunk& c) {
    const FacePart face = whole_face(side, c, found.face);
    found.point =
        (1.0 - found.along - found.across) * face.corner[0] + double(found.along) * face.corner[1] + double(found.across) * face.corner[2];
    found.answer = ask(side, found.point, found.answer.triangle);
    if (found.answer.distance < 0) c.found.push_back(found);
}

void search_poked(const Enough& enough, const Side& side, Best& total, double& left, Chunk& c) {
    for (const uint32_t face : c.poked) {
        Best best{0, total.queries, {}};
        push_part(whole_face(side, c, face), c);
        search(enough, side, best, left, c);
        total.queries = best.queries;
        if (best.found.face == kNone) continue;
        total.depth = std::max(total.depth, best.depth);
        add_found(side, best.found, c);
    }
}

// Searches the faces that may hold a point deeper than all known points of the pair.
void search_deepest(const Enough& enough, const Side& side, Best& best, double& left, Chunk& c) {
    const double to_beat = best.depth + enough.tolerance;
    for (const uint32_t face : side.screened) {
        const Triangle& t = side.mesh.triangle[face];
        if (std::isnan(c.depth[t[0]]) && std::isnan(c.depth[t[1]]) && std::isnan(c.depth[t[2]])) continue;
        FacePart part = whole_face(side, c, face);
        bound_by_corners(side, c, to_beat, part);
        if (part.bound > to_beat) push_part(part, c);
    }
    search(enough, side, best, left, c);
}

Side make_side(const ContactInputs& in, const ScreenedTriangles& screened, const CandidateTriangles& candidates, const NearVertices& near,
               uint32_t side_index) {
    const Surfaces& s = in.surfaces;
    const auto [pair, body, other, reversed] = pair_side(in.pairs, side_index);
    return {body,
            other,
            reversed,
            subspan(candidates.triangle, candidates.pair[pair]),
            subspan(screened.triangle, screened.body[body]),
            subspan(near.vertex, near.side[side_index]),
            subspan(near.triangle, near.side[side_index]),
            subspan(near.distance, near.side[side_index]),
            mesh_view(s.meshes, s.bodies.mesh[body]),
            mesh_view(s.meshes, s.bodies.mesh[other]),
            has_inside(s, other) ? in.trees[s.bodies.tree[other]].get() : nullptr,
            BodyPoints(s, body, s.poses.origin[other]),
            !is_deformable(s.bodies, other),
            s.poses.orientation[other],
            doubtful_depth(s, other)};
}

// Both sides of one pair, whose contacts are `range`. Returns the bound on unsearched parts, or 0.
double search_pair(const Enough& enough, const std::array<Side, 2>& sides, const Contacts& contacts, Range range,
                   std::array<Range, 2>& found, uint32_t& queries, Chunk& c) {
    Best best{-1, 0, {}};
    for (uint32_t i = range.first; i < range.end(); ++i) best.depth = std::max(best.depth, -contacts.distance[i]);
    const uint32_t first = uint32_t(c.found.size());
    uint32_t second = first;
    double left = 0;
    for (const Side& side : sides) {
        if (side.reversed) second = uint32_t(c.found.size());
        if (side.tree == nullptr || side.crossing.empty()) continue;
        collect_known(side, contacts, range, c);
        collect_poked(side, c);
        search_poked(enough, side, best, left, c);
    }
    const Side* deepest = nullptr;
    if (best.depth >= 0) {
        for (const Side& side : sides) {
            if (side.tree == nullptr) continue;
            collect_known(side, contacts, range, c);
            const double before = best.depth;
            search_deepest(enough, side, best, left, c);
            if (best.depth > before) deepest = &side;
        }
    }
    found = {Range{first, second - first}, Range{second, uint32_t(c.found.size()) - second}};
    queries = best.queries;
    if (deepest == nullptr) return left;
    const bool reversed = deepest->reversed;
    const auto end = c.found.begin() + found[reversed].end();
    const auto at = std::lower_bound(c.found.begin() + found[reversed].first, end, best.found.face,
                                     [](const FaceContact& f, uint32_t face) { return f.face < face; });
    if (at != end && at->face == best.found.face) return left;  // the face's deepest point is already known to the tolerance
    const auto index = at - c.found.begin();
    collect_known(*deepest, contacts, range, c);
    add_found(*deepest, best.found, c);
    if (c.found.size() == found[1].end()) return left;
    std::rotate(c.found.begin() + index, c.found.end() - 1, c.found.end());
    ++found[reversed].count;
    if (!reversed) ++found[1].first;
    return left;
}

void write_face(const Surfaces& s, uint32_t pair, const Side& side, const FaceContact& f, Contacts& to, uint32_t side_index) {
    const Triangle& t = side.mesh.triangle[f.face];
    write_contact(s, {pair, side.body, side.other, {t[0], t[1]}, f.along, t[2], f.across}, f.point, f.answer, to, side_index);
}

}  // namespace

void find_face_contacts(const ContactInputs& in, uint32_t most_queries, const ScreenedTriangles& screened,
                        const CandidateTriangles& candidates, const NearVertices& near, FaceDepthScratch& scratch, Contacts& contacts) {
    const Enough enough{in.params.tolerance, most_queries};
    const auto side_at = [&](uint32_t side_index) { return make_side(in, screened, candidates, near, side_index); };
    const uint32_t count = uint32_t(in.pairs.a.size()), grain = coarse_grain(count);
    const uint32_t chunks = chunk_count(count, grain);
    if (scratch.chunk.size() < chunks) scratch.chunk.resize(chunks);
    scratch.queries.assign(count, 0);
    scratch.side.assign(2 * count, {});
    contacts.most.assign(count, 0);
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        Chunk& chunk = scratch.chunk[begin / grain];
        chunk.found.clear();
        const auto lower = [&](uint32_t pair) {
            return uint32_t(std::lower_bound(contacts.pair.begin(), contacts.pair.end(), pair) - contacts.pair.begin());
        };
        for (uint32_t pair = begin; pair < end; ++pair) {
            const uint32_t first = lower(pair);
            std::array<Range, 2> found;
            contacts.most[pair] = search_pair(enough, {side_at(2 * pair), side_at(2 * pair + 1)}, contacts,
                                              {first, lower(pair + 1) - first}, found, scratch.queries[pair], chunk);
            scratch.side[2 * pair] = found[0];
            scratch.side[2 * pair + 1] = found[1];
        }
    });
    size_t range = contacts.pair.size();
    for (uint32_t i = 0; i < chunks; ++i) range += scratch.chunk[i].found.size();
    if (range == contacts.pair.size()) return;

    // merge from the back: vertices and edges of a side, then its faces
    uint32_t from = uint32_t(contacts.pair.size()), to = uint32_t(range);
    resize_contacts(contacts, range);
    for (uint32_t side_index = 2 * count; side_index-- > 0;) {
        const uint32_t body = pair_side(in.pairs, side_index).body;
        if (scratch.side[side_index].count > 0) {
            const Side side = side_at(side_index);
            const FaceContact* found = scratch.chunk[side_index / 2 / grain].found.data() + scratch.side[side_index].first;
            for (uint32_t i = scratch.side[side_index].count; i-- > 0;)
                write_face(in.surfaces, side_index / 2, side, found[i], contacts, --to);
        }
        while (from > 0 && contacts.pair[from - 1] == side_index / 2 && contacts.body[from - 1] == body)
            copy_contact(contacts, --from, contacts, --to);
    }
}

}  // namespace trocar
