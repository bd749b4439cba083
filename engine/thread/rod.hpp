#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "components/thread.hpp"
namespace trocar {

// Points of one thread: its reserved rows, of which the first `count` are in use.
struct Rod {
    uint32_t& count;
    std::span<double> material;    // m
    std::span<Vec3d> position;     // m
    std::span<Vec3d> velocity;     // m/s
    std::span<uint32_t> held;      // index of a hold, or kNone
    std::span<uint32_t> touching;  // kTouchesPerPoint per point: indices of touches, or kNone
};
inline std::span<uint32_t> touches_of(const Rod& rod, uint32_t i) {
    return rod.touching.subspan(size_t{kTouchesPerPoint} * i, kTouchesPerPoint);
}
Rod rod_of(const Thread& thread, uint32_t index, ThreadState& state);

// A surface that keeps a point of the thread on one side: normal . x >= offset.
struct RodPlane {
    Vec3d normal = Vec3d::Zero();    // unit; zero = none
    double offset = 0;               // m
    Vec3d velocity = Vec3d::Zero();  // m/s, of the surface
    double friction = 0;             // Coulomb coefficient
};
// Force of a plane on a point that was at `start` at the beginning of a step: a spring of kContactStiffness, and Coulomb's friction,
// which grows linearly up to its bound over 1 mm/s.
struct PlaneForce {
    Vec3d normal = Vec3d::Zero(), friction = Vec3d::Zero();  // N
    double drag = 0;                                         // N/m, of the friction
    double depth = 0;                                        // m
};
PlaneForce force_of_plane(const RodPlane& plane, const Vec3d& start, const Vec3d& now, double dt);
// N/m, of a point of a thread against a surface: 0.3 N, with which a taut thread presses where it turns, moves it by half of the
// thickness of a sheet of 1 mm, so that it stays on its side.
inline constexpr double kContactStiffness = 600;

// N/m, between the two points of a knot: as of what grips an end.
inline constexpr double kKnotStiffness = 2000;
// m/s, at which a new bite or knot draws its two sides together: that of a slow hand. Over a substep of 1e-4 s a spring of 1000 N/m
// gets 5 mN from it.
inline constexpr double kClosingSpeed = 0.05;
// Ratio of the tensions of loop and end up to which the thread does not slide in a knot; infinity: it locks, no matter how the loop pulls.
// In a throw one strand goes once round the other, which by the capstan equation lets exp(2 pi friction) through. The strands of a throw
// that is wound against the one before (a square knot) press on the ends of that one, from both sides, with the tension that the
// throws below let through: with pinching, T_loop = G (T_end + 2 friction T_loop G_squared / G), G = exp(2 pi friction throws), G_squared
// that of the squared throws. Throws wound the same way do not pinch: a sliding knot. The conditions are those of Bayman, American
// Journal of Physics 45(2), 1977, for hitches.
double grip_of_knot(double friction, const ThreadHold& knot);

// Reused memory of step_rod.
struct RodScratch {
    std::vector<double> band;                   // lower half of the matrix, row by row
    std::vector<double> right;                  // right-hand sides: of the points, then one per sliding bite, three per knot
    std::vector<double> rows;                   // of the bites: derivatives by the points beside them
    std::vector<double> small;                  // the bites' own system
    std::vector<double> slide;                  // m, changes of the bites
    std::vector<uint32_t> bite;                 // points that are bites, or slide in a knot
    std::vector<std::array<uint32_t, 2>> knot;  // points that are tied: that which stays, that which slides
    std::vector<double> mass, start_material;   // kg, m
    std::vector<Vec3d> start, goal;             // m
    std::vector<int8_t> flow;                   // per bite: 1 = the thread moves towards the needle, -1 = away, 0 = it sticks
    std::vector<double> grip;                   // exp(friction * wrap angle), per bite
};

struct RodStep {
    double friction_work = 0;    // J, of bites, <= 0
    double damping_work = 0;     // J, <= 0
    double knot_work = 0;        // J, that drew the strands of a new knot together
    double largest_tension = 0;  // N
    uint32_t iterations = 0;
    bool finite = true;  // else the thread is as it was, at rest
};

// Energies of a thread, J.
struct RodEnergy {
    double kinetic = 0, stretch = 0, bending = 0, gravity = 0;  // stretch: with that of knots
    double sum() const { return kinetic + stretch + bending + gravity; }
};
RodEnergy energy_of_rod(const Thread& thread, const Rod& rod, std::span<const ThreadHold> holds, const Vec3d& gravity);

// Axial stiffness, N; flexural rigidity, N m^2; mass per length, kg/m.
double stretch_stiffness(const Thread& thread);
double flexural_rigidity(const Thread& thread);
double mass_per_length(const Thread& thread);

// Tension of the piece from point i to the next, N; negative in compression.
double tension_of(const Thread& thread, const Rod& rod, uint32_t i);

// Moves a thread through `dt` by backward Euler: Newton's method on positions and on the places of the bites along the thread
// (Sueda et al., ACM Transactions on Graphics 30(4), 2011), with a factor of its banded matrix in each iteration. Bending is that of
// the change of the tangent, 1/2 B |t' - t|^2 / l, whose matrix is constant; within a piece of a bite or a held end the
// thread does not bend. holds[k] is joined to places[k] by its spring. At a bite the tensions on both sides obey the capstan equation,
// T' <= T exp(friction * angle) by which the thread turns there: the thread sticks below, slides at the bound. Where tension is below
// zero there is no friction. planes: per touch of rod.touching.
RodStep step_rod(const Thread& thread, const Vec3d& gravity, double dt, Rod rod, std::span<ThreadHold> holds, std::span<const Vec3d> places,
                 std::span<const RodPlane> planes, RodScratch& scratch);

// Adds and removes points beside bites, so that their pieces stay between half and 1.75 times the spacing, and takes off bites
// that the first end has left, if it bears no knot: they are marked as left. Returns the number of those.
uint32_t refine_rod(const Thread& thread, Rod rod, std::span<ThreadHold> holds);

// Makes a point of the thread at `material` (m), held by `hold`; between two others, at least 0.1 spacings from both. False if
// there is no room.
bool add_bite(const Thread& thread, double material, const Vec3d& place, uint32_t hold, Rod rod);

}  // namespace trocar
