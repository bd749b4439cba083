#include "systems/prepare/tool_sutures.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/thread/needle_grip.hpp"
#include "engine/thread/touch.hpp"
#include "engine/tissue/deformable_setup.hpp"
#include "engine/tissue/embedded_surface.hpp"
namespace trocar {
namespace {

// A place on a triangle of a body.
struct OnSurface {
    uint32_t triangle = kNone;
    Vec3d weight = Vec3d::Zero();
    double side = 1;
    Vec3d place = Vec3d::Zero();  // m, world
};

struct Corners {
    Vec3d at[3], normal;
};

Vec3d sewn_vertex(const Surfaces& s, uint32_t body, uint32_t vertex) { return frame_to_world(s, body, vertex_in_frame(s, body, vertex)); }

// of: place of a vertex, m.
template <typename Of>
Corners corners_of(const std::array<uint32_t, 3>& vertex, const Of& of) {
    Corners c;
    for (int k = 0; k < 3; ++k) c.at[k] = of(vertex[k]);
    c.normal = (c.at[1] - c.at[0]).cross(c.at[2] - c.at[0]);
    const double length = c.normal.norm();
    if (length > 0) c.normal /= length;
    return c;
}

// Barycentric coordinates of a point's foot in the plane of a triangle.
Vec3d foot_weights(const Corners& c, const Vec3d& at) {
    Vec3d w;
    for (int k = 0; k < 3; ++k) w[k] = c.normal.dot((c.at[(k + 2) % 3] - c.at[(k + 1) % 3]).cross(at - c.at[(k + 1) % 3]));
    const double sum = w.sum();
    return sum > 0 ? Vec3d(w / sum) : Vec3d(Vec3d::Constant(-1));
}

// Where a point that moved from `from`, when the surface's vertices were at `before`, to `to` passed through a body's surface; the first
// such place. Both ends are seen from the triangle as it was and as it is: heights over it are the same numbers at the end of one pass and
// at the begin of the next, so that no passing is found twice or not at all.
OnSurface find_crossing(const Surfaces& s, uint32_t body, std::span<const Vec3d> before, const Vec3d& from, const Vec3d& to) {
    // Two triangles that turn or bend while the point passes their edge may each see it beside them, by a second-order part of an edge.
    constexpr double kBesideEdge = 0.02;
    OnSurface best;
    double first = 2, inside = -kBesideEdge;
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        const Corners was = corners_of(mesh.triangle[t], [&](uint32_t v) { return before[v]; });
        const Corners is = corners_of(mesh.triangle[t], [&](uint32_t v) { return sewn_vertex(s, body, v); });
        const double a = was.normal.dot(from - was.at[0]), b = is.normal.dot(to - is.at[0]);
        if ((a < 0) == (b < 0)) continue;
        const double share = a / (a - b);
        const Vec3d w = (1 - share) * foot_weights(was, from) + share * foot_weights(is, to);
        const double least = std::min(w.minCoeff(), 0.0);
        if (least < inside || (least == inside && share >= first)) continue;
        inside = least, first = share;
        const Vec3d weight = w.cwiseMax(0.0) / w.cwiseMax(0.0).sum();
        best = {t, weight, b < 0 ? -1.0 : 1.0, weight[0] * is.at[0] + weight[1] * is.at[1] + weight[2] * is.at[2]};
    }
    return best;
}

NeedleHole make_hole(const ActionPass& pass, uint32_t sewn, uint32_t body, const OnSurface& on) {
    const Surfaces& s = pass.world.surfaces;
    const Triangle t = mesh_view(s.meshes, s.bodies.mesh[body]).triangle[on.triangle];
    NeedleHole hole;
    hole.sewn = sewn, hole.side = on.side;
    for (int k = 0; k < 3; ++k) hole.corner[k] = t[k];
    const SewnNodes under = nodes_under(pass, body, on.triangle, on.weight);
    hole.node = under.node, hole.weight = under.weight;
    return hole;
}

// The tissue at a hole takes hold of the needle. needle: its body.
ThreadHold make_grip(const ActionPass& pass, const SewnBody& sewn, const NeedleHole& hole, uint32_t needle) {
    ThreadHold grip;
    grip.thread = sewn.thread, grip.body = sewn.body, grip.action = sewn.action, grip.stiffness = sewn.stiffness;
    grip.node = hole.node, grip.weight = hole.weight;
    grip.before = sewn_place_at_velocity(pass, sewn.body, hole.node, hole.weight);
    grip.point = world_to_frame(pass.world.surfaces, needle, grip.before);
    return grip;
}

// Index of the grip of a hole. They have the same order.
uint32_t grip_of_hole(const ThreadState& state, size_t hole) {
    uint32_t h = 0;
    for (;; ++h)
        if (is_grip(state.hold[h]) && !state.hold[h].left && hole-- == 0) return h;
}

// Takes out a hole and its grip, whose energy is lost.
void close_hole(size_t hole, ThreadState& state, Energy& energy) {
    ThreadHold& grip = state.hold[grip_of_hole(state, hole)];
    energy.work_contact -= grip.stored;
    grip.stored = 0, grip.left = true;
    state.hole.erase(state.hole.begin() + static_cast<std::ptrdiff_t>(hole));
}

// Sets what the grips of an action bear: friction times the length of the needle in the tissue. In a sheet that is the wall, in a
// closed body the chord between two holes, of which each has half, or from a hole to the end that is inside.
void set_grip_limits(const ActionPass& pass, const Threads& threads, uint32_t index, const Vec3d& point, const Vec3d& end,
                     ThreadState& state) {
    const auto place = [&](const NeedleHole& h) { return sewn_place(pass, threads.sewn[h.sewn].body, h.node, h.weight); };
    for (size_t i = 0; i < state.hole.size(); ++i) {
        const NeedleHole& hole = state.hole[i];
        const SewnBody& sewn = threads.sewn[hole.sewn];
        if (sewn.action != index) continue;
        double length = pass.world.surfaces.bodies.thickness[sewn.body];
        if (has_inside(pass.world.surfaces, sewn.body)) {
            const bool entry = hole.side < 0;
            size_t other = entry ? i + 1 : i - 1;
            while (other < state.hole.size() && state.hole[other].sewn != hole.sewn) entry ? ++other : --other;
            const bool both = other < state.hole.size() && state.hole[other].side != hole.side;
            length = both ? 0.5 * (place(state.hole[other]) - place(hole)).norm() : ((entry ? point : end) - place(hole)).norm();
            length = std::min(length, (point - end).norm());  // there is no more of the needle
        }
        state.hold[grip_of_hole(state, i)].upper = pass.actions.action[index].friction * length;
    }
}

// The needle's point makes holes while it is pulled through, and leaves by those it is drawn back through at any time.
void make_holes(const ActionPass& pass, const Threads& threads, uint32_t index, const Vec3d& from, const Vec3d& to,
                ActionProgress& progress, ThreadState& state, Energy& energy) {
    for (uint32_t n = 0; n < threads.sewn.size(); ++n) {
        if (threads.sewn[n].action != index) continue;
        const uint32_t body = threads.sewn[n].body;
        const Range vertices = threads.sewn[n].vertices;
        const OnSurface on =
            find_crossing(pass.world.surfaces, body, std::span(state.before).subspan(vertices.first, vertices.count), from, to);
        if (on.triangle == kNone) continue;
        const auto near = [&](const NeedleHole& hole, double side) {
            return hole.sewn == n && hole.side == side && (sewn_place(pass, body, hole.node, hole.weight) - on.place).norm() < kWithdrawn;
        };
        // near a fold two triangles may see one passing in two passes
        if (std::ranges::any_of(state.hole, [&](const NeedleHole& hole) { return near(hole, on.side); })) continue;
        const auto withdrawn = std::ranges::find_if(state.hole, [&](const NeedleHole& hole) { return near(hole, -on.side); });
        if (withdrawn != state.hole.end()) {
            close_hole(static_cast<size_t>(withdrawn - state.hole.begin()), state, energy);
        } else if (!progress.on) {
            continue;
        } else if (state.hole.size() < threads.most_holes && state.hold.size() < threads.most_holds) {
            state.hole.push_back(make_hole(pass, n, body, on));
            state.hold.push_back(make_grip(pass, threads.sewn[n], state.hole.back(), pass.tools[pass.actions.action[index].tool].body));
        } else {
            ++progress.misfires;
        }
    }
}

// Puts the thread on a needle through a hole. It is on the thread where the thread is, and steps draw the two together: at once it
// would be stretched, or throw the tissue. False if there is no room.
bool make_bite(const ActionPass& pass, const Vec3d& gravity, const Threads& threads, const NeedleHole& hole, ThreadState& state,
               Energy& energy) {
    const SewnBody& sewn = threads.sewn[hole.sewn];
    const Thread& thread = threads.thread[sewn.thread];
    Rod rod = rod_of(thread, sewn.thread, state);
    const auto bites =
        std::ranges::count_if(state.hold, [&](const ThreadHold& h) { return h.thread == sewn.thread && h.slides && h.tied == kNone; });
    if (bites >= static_cast<std::ptrdiff_t>(thread.most_bites) || state.hold.size() >= threads.most_holds) return false;
    const uint32_t last = rod.count - 1;
    const double piece = rod.material[last] - rod.material[last - 1];
    ThreadHold hold;
    hold.thread = sewn.thread, hold.body = sewn.body, hold.action = sewn.action, hold.slides = true;
    hold.node = hole.node, hold.weight = hole.weight, hold.stiffness = sewn.stiffness;
    const Vec3d at = sewn_place_at_velocity(pass, sewn.body, hole.node, hole.weight);
    const double upper = std::clamp((rod.position[last] - at).norm(), 0.2 * piece, 0.5 * piece);
    const double share = 1 - upper / piece;
    const Vec3d place = rod.position[last - 1] + share * (rod.position[last] - rod.position[last - 1]);
    hold.before = place, hold.point = place - at;
    const double had = energy_of_rod(thread, rod, state.hold, gravity).sum();
    state.hold.push_back(hold);
    const auto index = static_cast<uint32_t>(state.hold.size() - 1);
    const bool made = add_bite(thread, rod.material[last] - upper, place, index, rod);
    if (!made) state.hold.pop_back();
    if (!made) return false;
    energy.work_numeric += energy_of_rod(thread, rod, state.hold, gravity).sum() - had;  // it does not bend at a bite
    return true;
}

uint32_t find_row(const Rod& rod, const auto& is) {
    uint32_t i = 0;
    while (i < rod.count && !(rod.held[i] != kNone && is(rod.held[i]))) ++i;
    return i;
}

// Ties the strand of the needle to that of the first end, beside the bites that they come out of. False if there is no room.
bool tie_strands(const Vec3d& gravity, const Thread& thread, uint32_t index, uint32_t first, uint32_t last, uint32_t room,
                 ThreadState& state, Energy& energy) {
    Rod rod = rod_of(thread, index, state);
    const double near = 1.5 * thread.spacing;
    uint32_t stays = first;
    while (stays > 0 && (rod.material[first] - rod.material[stays] < near || rod.held[stays] != kNone)) --stays;
    const double across = (rod.position[stays] - rod.position[last]).norm(), place = rod.material[last] + std::max(near, across);
    if (stays == 0 || state.hold.size() + 2 > room) return false;
    uint32_t above = last + 1;
    while (above < rod.count && rod.material[above] <= place) ++above;
    if (above >= rod.count) return false;
    const double share = (place - rod.material[above - 1]) / (rod.material[above] - rod.material[above - 1]);
    const Vec3d at = rod.position[above - 1] + share * (rod.position[above] - rod.position[above - 1]);
    const auto held = static_cast<uint32_t>(state.hold.size());
    const double had = energy_of_rod(thread, rod, state.hold, gravity).sum();
    ThreadHold knot;
    knot.thread = index, knot.tied = held + 1;
    state.hold.push_back(knot);
    knot.tied = held, knot.slides = true, knot.point = at - rod.position[stays];
    state.hold.push_back(knot);
    if (!add_bite(thread, place, at, held + 1, rod)) {
        state.hold.resize(held);
        return false;
    }
    rod.held[stays] = held;
    energy.work_numeric += energy_of_rod(thread, rod, state.hold, gravity).sum() - had;
    return true;
}

// A needle that goes once round the strand of the first end, which something holds, makes a throw. from, to: of its blunt end.
void wind(const Vec3d& gravity, const Threads& threads, uint32_t index, const Vec3d& from, const Vec3d& to, ActionProgress& progress,
          ThreadState& state, Energy& energy) {
    const Thread& thread = threads.thread[index];
    Rod rod = rod_of(thread, index, state);
    ThreadProgress& done = state.progress[index];
    const auto of_tissue = [&](uint32_t h) { return state.hold[h].slides && state.hold[h].tied == kNone; };
    const uint32_t first = find_row(rod, of_tissue);
    uint32_t last = rod.count;
    while (last > 0 && !(rod.held[last - 1] != kNone && of_tissue(rod.held[last - 1]))) --last;
    const Vec3d base = first < rod.count ? rod.position[first] : rod.position[0];
    const Vec3d strand = rod.position[0] - base;
    const double length = strand.norm();
    const auto across = [&](const Vec3d& at) { return Vec3d(at - base - (at - base).dot(strand) / (length * length) * strand); };
    const double height = length > 0 ? (to - base).dot(strand) / length : 0;
    const bool beside = rod.held[0] != kNone && length > kLeastStrand && height > 0 && height < length && across(to).norm() < kWindingReach;
    if (!beside) {
        done.wound = 0;
        return;
    }
    const Vec3d a = across(from), b = across(to);
    done.wound += std::atan2(strand.dot(a.cross(b)) / length, a.dot(b));
    if (std::abs(done.wound) < 2 * std::numbers::pi) return;
    const double way = done.wound > 0 ? 1 : -1;
    done.wound -= 2 * std::numbers::pi * way;
    const auto knot =
        std::ranges::find_if(state.hold, [&](const ThreadHold& h) { return h.thread == index && h.slides && h.tied != kNone; });
    const bool fresh = knot == state.hold.end();
    if (fresh && !tie_strands(gravity, thread, index, first, last - 1, threads.most_holds, state, energy)) {
        ++progress.misfires;
        return;
    }
    ThreadHold& slides = fresh ? state.hold.back() : *knot;
    slides.squared += slides.throws > 0 && way != slides.way;
    ++slides.throws, slides.way = way, ++done.throws;
}

// Whether the needle's blunt end has passed a hole. A plane goes on beyond the hole: the end has passed that only if it is within half of
// the needle beside it, or nearer to it than the point.
bool has_passed(const Corners& corners, double side, const Vec3d& hole, const Vec3d& point, const Vec3d& end) {
    const Vec3d way = end - hole;
    const double height = corners.normal.dot(way);
    const bool near = (way - height * corners.normal).norm() < 0.5 * (end - point).norm() || way.norm() < (point - hole).norm();
    return side * height > 0 && near;
}

// The needle's blunt end takes the thread through the holes, in their order.
void draw_through(const ActionPass& pass, const Vec3d& gravity, const Threads& threads, uint32_t index, const Vec3d& point,
                  const Vec3d& end, ActionProgress& progress, ThreadState& state, Energy& energy) {
    const Surfaces& s = pass.world.surfaces;
    while (true) {
        const auto hole = std::ranges::find_if(state.hole, [&](const NeedleHole& h) { return threads.sewn[h.sewn].action == index; });
        if (hole == state.hole.end()) return;
        const uint32_t body = threads.sewn[hole->sewn].body;
        const Corners c = corners_of(hole->corner, [&](uint32_t v) { return sewn_vertex(s, body, v); });
        const Vec3d at = sewn_place(pass, body, hole->node, hole->weight);
        if (!has_passed(c, hole->side, at, point, end)) return;
        make_bite(pass, gravity, threads, *hole, state, energy) ? ++progress.done : ++progress.misfires;
        close_hole(static_cast<size_t>(hole - state.hole.begin()), state, energy);
    }
}

// Bites that the end of a thread has left are taken out of the list.
bool drop_left(ThreadState& state) {
    bool any = false;
    for (uint32_t h = 0; h < state.hold.size();) {
        if (!state.hold[h].left) {
            ++h;
            continue;
        }
        state.hold.erase(state.hold.begin() + h);
        for (uint32_t& held : state.held)
            if (held != kNone && held > h) --held;
        for (ThreadHold& other : state.hold)
            if (other.tied != kNone && other.tied > h) --other.tied;
        any = true;
    }
    return any;
}

}  // namespace

void sew(const ActionPass& pass, const Vec3d& gravity, const Threads& threads, SewScratch& scratch, ActionState& actions,
         ThreadState& state, Sleep& sleep, Energy& energy) {
    for (ThreadProgress& progress : state.progress) progress.stepped = false;
    for (ThreadHold& hold : state.hold) hold.impulse.setZero();
    const size_t before = state.hold.size();
    bool changed = drop_left(state);
    for (uint32_t index = 0; index < pass.actions.action.size(); ++index) {
        const ToolAction& action = pass.actions.action[index];
        if (action.kind != ActionKind::kSuture) continue;
        ActionProgress& progress = actions.progress[index];
        const Surfaces& s = pass.world.surfaces;
        const uint32_t needle = pass.tools[action.tool].body;
        const Vec3d point = frame_to_world(s, needle, action.point), end = frame_to_world(s, needle, action.edge);
        const bool in_holes =
            std::ranges::any_of(state.hole, [&](const NeedleHole& hole) { return threads.sewn[hole.sewn].action == index; });
        if (progress.on ? progress.swept : in_holes) make_holes(pass, threads, index, progress.from, point, progress, state, energy);
        const bool swept = progress.on && progress.swept;
        draw_through(pass, gravity, threads, index, point, end, progress, state, energy);
        for (uint32_t t = 0; swept && t < threads.thread.size(); ++t)
            if (threads.thread[t].tool == action.tool) wind(gravity, threads, t, progress.from_edge, end, progress, state, energy);
        set_grip_limits(pass, threads, index, point, end, state);
        progress.swept = progress.on, progress.from = point, progress.from_edge = end;
    }
    changed = drop_left(state) || changed;
    for (const SewnBody& sewn : threads.sewn)
        for (uint32_t v = 0; v < sewn.vertices.count; ++v)
            state.before[sewn.vertices.first + v] = sewn_vertex(pass.world.surfaces, sewn.body, v);
    const bool touched = !state.touch.empty();
    find_thread_contacts(pass, threads, scratch.contacts, state, energy);
    changed = changed || touched || !state.touch.empty() || state.hold.size() != before ||
              state.stable_dt.size() != pass.world.surfaces.bodies.mesh.size();
    if (changed) update_thread_limits(pass, threads, scratch.limits, state);
    for (const ThreadHold& hold : state.hold)
        if (hold.body != kNone) wake_body(sleep, hold.body);
    for (const ThreadTouch& touch : state.touch) wake_body(sleep, touch.body);
}

namespace {

// Calls add(first, body) for each body that holds a thread, or only touches it, and is moved by forces; first: the first of both. That one
// is joined to itself: so others know that something moves it, also where nothing else is on the thread.
void each_join(const Bodies& bodies, const ThreadState& state, bool of_touches, const auto& add) {
    for (uint32_t thread = 0; thread < state.count.size(); ++thread) {
        const auto joins = [&](const auto& at) { return at.thread == thread && at.body != kNone && joins_islands(bodies.motion[at.body]); };
        const auto among = [&](const auto& list, size_t count, uint32_t body) {
            return std::any_of(list.begin(), list.begin() + static_cast<std::ptrdiff_t>(count),
                               [&](const auto& at) { return at.thread == thread && at.body == body; });
        };
        uint32_t first = kNone;
        for (size_t h = 0; h < state.hold.size(); ++h) {
            const uint32_t body = state.hold[h].body;
            if (!joins(state.hold[h]) || among(state.hold, h, body)) continue;
            if (first == kNone) first = body;
            if (!of_touches) add(first, body);
        }
        for (size_t k = 0; of_touches && k < state.touch.size(); ++k) {
            const uint32_t body = state.touch[k].body;
            if (!joins(state.touch[k]) || among(state.touch, k, body) || among(state.hold, state.hold.size(), body)) continue;
            if (first == kNone) first = body;
            add(first, body);
        }
    }
}

}  // namespace

void join_threaded_bodies(const Bodies& bodies, const ThreadState& state, std::vector<std::array<uint32_t, 2>>& joined) {
    for (const bool of_touches : {false, true})
        each_join(bodies, state, of_touches, [&](uint32_t first, uint32_t body) { joined.push_back({first, body}); });
}

size_t count_touch_joins(const Bodies& bodies, const ThreadState& state) {
    size_t count = 0;
    each_join(bodies, state, true, [&](uint32_t, uint32_t) { ++count; });
    return count;
}

void update_thread_limits(const ActionPass& pass, const Threads& threads, std::vector<double>& scratch, ThreadState& state) {
    const Bodies& bodies = pass.world.surfaces.bodies;
    const Solids& solids = pass.world.solids;
    const Particles& particles = pass.world.surfaces.particles;
    state.stable_dt.assign(bodies.mesh.size(), std::numeric_limits<double>::infinity());
    // Gershgorin's rows of k w w^T over the masses, 1/s^2
    scratch.assign(particles.offset.size() + bodies.mesh.size(), 0.0);
    double* const rigid = scratch.data() + particles.offset.size();
    const auto add = [&](const auto& at, double stiffness) {
        if (at.body == kNone) return;
        if (!is_deformable(bodies, at.body)) {
            rigid[at.body] += stiffness * bodies.inv_mass[at.body];
            return;
        }
        double all = 0;
        for (uint32_t k = 0; k < 4 && at.node[k] != kNone; ++k) all += std::abs(at.weight[k]);
        const uint32_t first = bodies.particles[at.body].first + embedded_count(solids, bodies.mesh[at.body]);
        for (uint32_t k = 0; k < 4 && at.node[k] != kNone; ++k) {
            const uint32_t p = first + at.node[k];
            scratch[p] += stiffness * all * std::abs(at.weight[k]) * static_cast<double>(particles.offset[p].w);
        }
    };
    for (const ThreadHold& hold : state.hold) {
        if (hold.left) continue;
        add(hold, hold.stiffness);
        if (!is_grip(hold)) continue;  // its spring pulls the needle too
        const uint32_t needle = pass.tools[threads.thread[hold.thread].tool].body;
        rigid[needle] += hold.stiffness * bodies.inv_mass[needle];
    }
    for (const ThreadTouch& touch : state.touch) add(touch, kContactStiffness);
    for (uint32_t body = 0; body < bodies.mesh.size(); ++body) {
        double most = rigid[body];
        const Range rows = bodies.particles[body];
        for (uint32_t p = rows.first; p < rows.end(); ++p) most = std::max(most, scratch[p]);
        if (most == 0) continue;
        // omega^2 of a sum of springs is at most the sum of theirs
        const double own = 2 * kStableShare / bodies.stable_dt[body];
        state.stable_dt[body] = 2 * kStableShare / std::sqrt(own * own + most);
    }
}

void note_thread_forces(double seconds, const Threads& threads, bool first, const ThreadState& state, std::span<ToolState> tools) {
    for (ToolState& tool : tools)
        if (first) tool.link_force_before = tool.link_force, tool.link_force.setZero();
    for (const ThreadHold& hold : state.hold) {
        if (hold.slides || hold.left) continue;
        const uint32_t tool = threads.thread[hold.thread].tool;
        if (tool != kNone && hold.body != kNone) tools[tool].link_force += (is_grip(hold) ? -1 : 1) / seconds * hold.impulse;
    }
}

void step_lone_threads(const ThreadsAlone& in, const Threads& threads, LoneThreadScratch& scratch, ThreadState& state, Energy& energy) {
    constexpr double kLongest = 1e-3;  // s
    scratch.place.reserve(threads.most_holds), scratch.plane.reserve(state.touching.size());
    scratch.place.resize(state.hold.size());
    const auto spring = [](const ThreadHold& hold, const Vec3d& stretch) { return 0.5 * hold.stiffness * stretch.squaredNorm(); };
    for (uint32_t index = 0; index < threads.thread.size(); ++index) {
        const Thread& thread = threads.thread[index];
        ThreadProgress& progress = state.progress[index];
        if (progress.stepped) continue;
        Rod rod = rod_of(thread, index, state);
        const auto steps = static_cast<uint32_t>(std::ceil(in.seconds / kLongest - 1e-9));
        const double dt = in.seconds / steps;
        const auto sum = [&] {
            double all = energy_of_rod(thread, rod, state.hold, in.gravity).sum();
            for (uint32_t i = 0; i < rod.count; ++i) {
                if (const uint32_t h = rod.held[i]; h != kNone)
                    all += spring(state.hold[h], rod.position[i] - state.hold[h].before);
                else
                    for (const uint32_t t : touches_of(rod, i))
                        if (t != kNone) all += energy_of_touch(state.touch[t], rod.position[i], state.touch[t].before);
            }
            return all;
        };
        scratch.plane.resize(state.touch.size());
        for (uint32_t k = 0; k < steps; ++k) {
            for (uint32_t i = 0; i < rod.count; ++i) {
                const uint32_t h = rod.held[i];
                if (h == kNone) continue;
                ThreadHold& hold = state.hold[h];
                const Vec3d goal = hold.body == kNone
                                       ? hold.point
                                       : Vec3d(in.poses.origin[hold.body] + rotate(in.poses.orientation[hold.body], hold.point));
                scratch.place[h] = hold.before + (goal - hold.before) / (steps - k);
                energy.work_hand += spring(hold, rod.position[i] - scratch.place[h]) - spring(hold, rod.position[i] - hold.before);
                hold.before = scratch.place[h];
            }
            for (uint32_t i = 0; i < rod.count; ++i)
                for (const uint32_t t : touches_of(rod, i)) {
                    if (t == kNone) continue;
                    ThreadTouch& touch = state.touch[t];
                    energy.work_contact += let_out(thread.radius + 0.5 * in.bodies.thickness[touch.body], dt, rod.position[i], touch);
                    scratch.plane[t] = {touch.normal, touch.normal.dot(touch.before) + touch.gap, Vec3d::Zero(), touch.friction};
                }
            const double before = sum();
            const RodStep step = step_rod(thread, in.gravity, dt, rod, state.hold, scratch.place, scratch.plane, scratch.rod);
            double rubbed = 0;
            for (uint32_t i = 0; i < rod.count; ++i) {
                if (rod.held[i] != kNone) continue;
                const Vec3d start = rod.position[i] - dt * rod.velocity[i];
                for (const uint32_t t : touches_of(rod, i))
                    if (t != kNone)
                        rubbed += dt * force_of_plane(scratch.plane[t], start, rod.position[i], dt).friction.dot(rod.velocity[i]);
            }
            progress.largest_tension = std::max(progress.largest_tension, step.largest_tension);
            progress.friction_work += step.friction_work;
            energy.work_damping += step.damping_work, energy.work_contact += step.friction_work + rubbed;
            energy.work_links += step.knot_work;
            energy.work_numeric += sum() - before - step.damping_work - step.friction_work - step.knot_work - rubbed;
        }
        for (uint32_t i = 0; i < rod.count; ++i) {
            const uint32_t h = rod.held[i];
            if (h == kNone) continue;
            ThreadHold& hold = state.hold[h];
            hold.stored = spring(hold, rod.position[i] - hold.before);
        }
        for (uint32_t i = 0; i < rod.count; ++i)
            for (const uint32_t t : touches_of(rod, i))
                if (rod.held[i] == kNone && t != kNone)
                    state.touch[t].stored = energy_of_touch(state.touch[t], rod.position[i], state.touch[t].before);
    }
}

}  // namespace trocar
