#include "engine/thread/rod.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
namespace trocar {
namespace {

constexpr uint32_t kHalfBand = 6;  // entries left of the diagonal: bending joins every point to the second next, axis by axis
constexpr uint32_t kWidth = kHalfBand + 1;
constexpr double kShortest = 0.1;         // of the spacing: least piece beside a bite
constexpr uint32_t kMostIterations = 25;  // of 9000 steps of the scene suture that agree, one took more
constexpr uint32_t kSecant = 12;          // iterations from which friction of surfaces is linearised by its secant
constexpr double kConverged = 1e-10;      // m, largest change in an iteration: a tension of 1e-5 N in a piece of 1 mm
constexpr double kFarthest = 0.5;         // of the spacing: most that an iteration moves a point
constexpr uint32_t kMostKnots = 1;        // of a thread

using Matrix = Eigen::Matrix3d;

struct Piece {
    Vec3d along = Vec3d::Zero();  // unit
    double length = 0, rest = 0, tension = 0;
};

Piece piece_of(double stiffness, const Rod& rod, uint32_t i) {
    Piece p;
    const Vec3d d = rod.position[i + 1] - rod.position[i];
    p.length = std::max(d.norm(), 1e-15);
    p.along = d / p.length;
    p.rest = rod.material[i + 1] - rod.material[i];
    p.tension = stiffness * (p.length / p.rest - 1);
    return p;
}

// What a step is made from.
struct Step {
    const Thread& thread;
    Vec3d gravity;
    double dt;
    Rod rod;
    std::span<ThreadHold> holds;
    std::span<const Vec3d> places;
    std::span<const RodPlane> planes;
    RodScratch& s;
    double stiffness, rigidity;
    bool stuck = false;  // no bite slides in this step
    uint32_t iteration = 0;
};

bool is_bite(const Step& e, uint32_t i) { return e.rod.held[i] != kNone && e.holds[e.rod.held[i]].slides; }
bool bends(const Step& e, uint32_t i) { return !is_bite(e, i - 1) && !is_bite(e, i) && !is_bite(e, i + 1); }

// Row that a hold has, or the count.
uint32_t row_of_hold(const Rod& rod, uint32_t hold) {
    uint32_t i = 0;
    while (i < rod.count && rod.held[i] != hold) ++i;
    return i;
}

// Row of the other point of a knot, or kNone: no knot, or its other point has gone.
uint32_t tied_row(const Rod& rod, std::span<const ThreadHold> holds, uint32_t i) {
    if (rod.held[i] == kNone || !holds[rod.held[i]].slides || holds[rod.held[i]].tied == kNone) return kNone;
    const uint32_t row = row_of_hold(rod, holds[rod.held[i]].tied);
    return row < rod.count ? row : kNone;
}

double& entry(RodScratch& s, uint32_t row, uint32_t column) { return s.band[size_t{row} * kWidth + (column + kHalfBand - row)]; }

void add_diagonal(RodScratch& s, uint32_t i, const Matrix& k) {
    for (uint32_t a = 0; a < 3; ++a)
        for (uint32_t b = 0; b <= a; ++b) entry(s, 3 * i + a, 3 * i + b) += k(a, b);
}
void add_next(RodScratch& s, uint32_t i, const Matrix& k) {  // of point i + 1 by point i
    for (uint32_t a = 0; a < 3; ++a)
        for (uint32_t b = 0; b < 3; ++b) entry(s, 3 * i + 3 + a, 3 * i + b) += k(a, b);
}
void add_right(RodScratch& s, uint32_t i, const Vec3d& f) {
    for (uint32_t a = 0; a < 3; ++a) s.right[3 * i + a] += f[a];
}

void add_inertia(Step& e) {
    const double drag = 1 + e.thread.damping * e.dt, per_dt2 = 1 / (e.dt * e.dt);
    for (uint32_t i = 0; i < e.rod.count; ++i) {
        const double m = e.s.mass[i];
        add_right(e.s, i, m * (e.gravity + per_dt2 * (e.s.goal[i] - drag * (e.rod.position[i] - e.s.start[i]))));
        for (uint32_t a = 0; a < 3; ++a) entry(e.s, 3 * i + a, 3 * i + a) += m * drag * per_dt2;
    }
}

void add_pieces(Step& e) {
    for (uint32_t i = 0; i + 1 < e.rod.count; ++i) {
        const Piece p = piece_of(e.stiffness, e.rod, i);
        add_right(e.s, i, p.tension * p.along), add_right(e.s, i + 1, -p.tension * p.along);
        const Matrix axial = p.along * p.along.transpose();
        // the part of compression would make the matrix indefinite
        const Matrix k = e.stiffness / p.rest * axial + std::max(p.tension, 0.0) / p.length * (Matrix::Identity() - axial);
        add_diagonal(e.s, i, k), add_diagonal(e.s, i + 1, k), add_next(e.s, i, -k);
    }
}

void add_bending(Step& e) {
    for (uint32_t i = 1; i + 1 < e.rod.count; ++i) {
        if (!bends(e, i)) continue;
        const double before = e.rod.material[i] - e.rod.material[i - 1], after = e.rod.material[i + 1] - e.rod.material[i];
        const double weight = 2 * e.rigidity / (before + after);
        const double c[3] = {1 / before, -1 / before - 1 / after, 1 / after};
        Vec3d change = Vec3d::Zero();
        for (uint32_t k = 0; k < 3; ++k) change += c[k] * e.rod.position[i - 1 + k];
        for (uint32_t k = 0; k < 3; ++k) {
            add_right(e.s, i - 1 + k, -weight * c[k] * change);
            for (uint32_t j = 0; j <= k; ++j)
                for (uint32_t a = 0; a < 3; ++a) entry(e.s, 3 * (i - 1 + k) + a, 3 * (i - 1 + j) + a) += weight * c[k] * c[j];
        }
    }
}

void add_holds(Step& e) {
    for (uint32_t i = 0; i < e.rod.count; ++i) {
        if (e.rod.held[i] == kNone) continue;
        const ThreadHold& hold = e.holds[e.rod.held[i]];
        add_right(e.s, i, hold.stiffness * (e.places[e.rod.held[i]] - e.rod.position[i]));
        for (uint32_t a = 0; a < 3; ++a) entry(e.s, 3 * i + a, 3 * i + a) += hold.stiffness;
    }
}

void add_plane(Step& e, uint32_t i, const RodPlane& plane) {
    const PlaneForce force = force_of_plane(plane, e.s.start[i], e.rod.position[i], e.dt);
    if (!(force.depth > 0)) return;
    const Matrix axial = plane.normal * plane.normal.transpose();
    add_right(e.s, i, force.normal + force.friction);
    Matrix across = Matrix::Identity() - axial;
    // what slides has the same friction a little farther along; that is left out again where points go to and fro about the bound
    const double bound = plane.friction * force.normal.norm();
    if (e.iteration < kSecant && bound > 0 && force.friction.norm() > (1 - 1e-9) * bound)
        across -= force.friction * force.friction.transpose() / force.friction.squaredNorm();
    add_diagonal(e.s, i, kContactStiffness * axial + force.drag * across);
}

void add_planes(Step& e) {
    for (uint32_t i = 0; i < e.rod.count; ++i) {
        if (e.rod.held[i] != kNone) continue;
        for (const uint32_t touch : touches_of(e.rod, i))
            if (touch != kNone) add_plane(e, i, e.planes[touch]);
    }
}

// L D L^T of the band, in place, column by column: its updates do not wait for each other.
void factor_band(RodScratch& s, uint32_t rows) {
    for (uint32_t r = 0; r < rows; ++r) {
        const uint32_t below = std::min(kHalfBand, rows - 1 - r);
        double* const band = &s.band[size_t{r} * kWidth + kHalfBand];
        const auto at = [&](uint32_t down, uint32_t right) -> double& { return band[size_t{down} * kWidth + right - down]; };
        const double inverse = 1 / at(0, 0);
        double column[kHalfBand + 1];
        for (uint32_t k = 1; k <= below; ++k) column[k] = at(k, 0);
        for (uint32_t k = 1; k <= below; ++k) {
            at(k, 0) = column[k] * inverse;
            for (uint32_t j = 1; j <= k; ++j) at(k, j) -= at(k, 0) * column[j];
        }
    }
}

// x: right-hand side, of which the rows below `first` are zero, and solution.
void solve_band(const RodScratch& s, uint32_t rows, uint32_t first, double* x) {
    for (uint32_t r = first; r < rows; ++r) {
        const uint32_t below = std::min(kHalfBand, rows - 1 - r);
        for (uint32_t k = 1; k <= below; ++k) x[r + k] -= s.band[size_t{r + k} * kWidth + kHalfBand - k] * x[r];
    }
    for (uint32_t r = 0; r < rows; ++r) x[r] /= s.band[size_t{r} * kWidth + kHalfBand];
    for (uint32_t r = rows; r-- > 0;) {
        const double* row = &s.band[size_t{r} * kWidth + kHalfBand];
        const uint32_t above = std::min(kHalfBand, r);
        for (uint32_t k = 1; k <= above; ++k) x[r - k] -= row[-static_cast<std::ptrdiff_t>(k)] * x[r];
    }
}

// How the thread moves at a bite: the primal-dual active set of the capstan inequality.
void choose_flow(Step& e, uint32_t k) {
    const uint32_t b = e.s.bite[k];
    const Piece lower = piece_of(e.stiffness, e.rod, b - 1), upper = piece_of(e.stiffness, e.rod, b);
    const double cosine = std::clamp(lower.along.dot(upper.along), -1.0, 1.0);
    const ThreadHold& hold = e.holds[e.rod.held[b]];
    const bool knot = hold.tied != kNone;
    e.s.grip[k] = knot ? grip_of_knot(e.thread.friction, hold) : std::exp(e.thread.friction * std::acos(cosine));
    const int8_t before = std::exchange(e.s.flow[k], int8_t{0});
    if (std::isinf(e.s.grip[k])) return;
    const double grip = e.s.grip[k], push = e.stiffness / e.thread.spacing, moved = e.rod.material[b] - e.s.start_material[b];
    const double ahead = upper.tension - (lower.tension > 0 ? grip : 1) * lower.tension - push * moved;
    const double back = lower.tension - (upper.tension > 0 ? grip : 1) * upper.tension + push * moved;
    int8_t flow = ahead > 0 ? 1 : back > 0 ? -1 : 0;
    // slack thread is not pushed through; what got slack by sliding in this step does not go back
    if (e.stuck || (flow != before && lower.tension <= 0 && upper.tension <= 0)) flow = 0;
    // what slides comes to stick before it may slide the other way: from bound to bound it would go to and fro
    if (flow * before < 0) flow = 0;
    // no piece gets shorter than kShortest
    const double least = kShortest * e.thread.spacing * (1 + 1e-9);
    if ((flow > 0 && lower.rest <= least) || (flow < 0 && upper.rest <= least)) flow = 0;
    e.s.flow[k] = flow;
}

// Change of the place of a bite that sticks: what slid and sticks again goes back to where it was, unless its piece is the shortest that
// may be. m
double way_back(const Step& e, uint32_t b) {
    const double back = e.s.start_material[b] - e.rod.material[b];
    const double lower = e.rod.material[b] - e.rod.material[b - 1], upper = e.rod.material[b + 1] - e.rod.material[b];
    const double least = kShortest * e.thread.spacing * (1 + 1e-9);
    return (back > 0 && lower <= least) || (back < 0 && upper <= least) ? 0 : back;
}
bool moves(const Step& e, uint32_t k) { return e.s.flow[k] != 0 || way_back(e, e.s.bite[k]) != 0; }

// Derivatives of the points' forces by the place of bite k along the thread.
void set_column(Step& e, uint32_t k, double* column) {
    const uint32_t b = e.s.bite[k];
    const Piece lower = piece_of(e.stiffness, e.rod, b - 1), upper = piece_of(e.stiffness, e.rod, b);
    const double less = e.stiffness * lower.length / (lower.rest * lower.rest),
                 more = e.stiffness * upper.length / (upper.rest * upper.rest);
    for (uint32_t a = 0; a < 3; ++a) {
        column[3 * (b - 1) + a] = -less * lower.along[a];
        column[3 * b + a] = less * lower.along[a] + more * upper.along[a];
        column[3 * (b + 1) + a] = -more * upper.along[a];
    }
}

// Row k of the bites' system: what its equation lacks, and its derivatives.
void set_small_row(Step& e, uint32_t k, uint32_t unknowns, const double* y, uint32_t stride) {
    const auto bites = static_cast<uint32_t>(e.s.bite.size());
    double* row = &e.s.small[size_t{k} * (unknowns + 1)];
    std::fill_n(row, unknowns + 1, 0.0);
    const uint32_t b = e.s.bite[k];
    const int8_t flow = e.s.flow[k];
    if (flow == 0) {
        row[k] = 1, row[unknowns] = way_back(e, b);
        return;
    }
    const Piece lower = piece_of(e.stiffness, e.rod, b - 1), upper = piece_of(e.stiffness, e.rod, b);
    const double grip = e.s.grip[k];
    // equation: up T(upper) + down T(lower) = 0
    const double up = flow > 0 ? 1 : -(upper.tension > 0 ? grip : 1), down = flow > 0 ? -(lower.tension > 0 ? grip : 1) : 1;
    const double less = e.stiffness * lower.length / (lower.rest * lower.rest),
                 more = e.stiffness * upper.length / (upper.rest * upper.rest);
    const double by_lower = down * e.stiffness / lower.rest, by_upper = up * e.stiffness / upper.rest;
    const auto along = [&](const double* x) {  // derivative of the equation in the direction x
        double sum = 0;
        for (uint32_t a = 0; a < 3; ++a) {
            sum += by_lower * lower.along[a] * (x[3 * b + a] - x[3 * (b - 1) + a]);
            sum += by_upper * upper.along[a] * (x[3 * (b + 1) + a] - x[3 * b + a]);
        }
        return sum;
    };
    row[unknowns] = -(up * upper.tension + down * lower.tension) - along(y);
    for (uint32_t j = 0; j < unknowns; ++j) row[j] = along(y + size_t{j + 1} * stride);
    row[k] += up * more - down * less;
    if (k > 0 && e.s.bite[k - 1] == b - 1) row[k - 1] += down * less;
    if (k + 1 < bites && e.s.bite[k + 1] == b + 1) row[k + 1] -= up * more;
}

// Rows of knot q in the same system. Its unknowns are the force from the point near the first end to the other one, N, axis by axis.
void set_knot_rows(Step& e, uint32_t q, uint32_t unknowns, const double* y, uint32_t stride) {
    const auto [stays, slides] = e.s.knot[q];
    const auto first = static_cast<uint32_t>(e.s.bite.size()) + 3 * q;
    const Vec3d apart = e.rod.position[slides] - e.rod.position[stays] - e.holds[e.rod.held[slides]].point;
    for (uint32_t a = 0; a < 3; ++a) {
        double* row = &e.s.small[size_t{first + a} * (unknowns + 1)];
        const auto between = [&](const double* x) { return x[3 * slides + a] - x[3 * stays + a]; };
        for (uint32_t j = 0; j < unknowns; ++j) row[j] = between(y + size_t{j + 1} * stride);
        row[first + a] -= 1 / kKnotStiffness;
        row[unknowns] = -apart[a] - between(y);
    }
}

// Gauss with row pivoting; the last column is the right-hand side and becomes the solution.
void solve_small(std::vector<double>& m, uint32_t n, std::vector<double>& x) {
    const uint32_t w = n + 1;
    for (uint32_t c = 0; c < n; ++c) {
        uint32_t best = c;
        for (uint32_t r = c + 1; r < n; ++r)
            if (std::abs(m[r * w + c]) > std::abs(m[best * w + c])) best = r;
        if (best != c) std::swap_ranges(&m[c * w], &m[c * w] + w, &m[best * w]);
        for (uint32_t r = c + 1; r < n; ++r) {
            const double f = m[r * w + c] / m[c * w + c];
            if (f == 0) continue;
            for (uint32_t k = c; k <= n; ++k) m[r * w + k] -= f * m[c * w + k];
        }
    }
    for (uint32_t r = n; r-- > 0;) {
        double value = m[r * w + n];
        for (uint32_t c = r + 1; c < n; ++c) value -= m[r * w + c] * x[c];
        x[r] = value / m[r * w + r];
    }
}

// Moves the bites along the thread, no farther than their neighbours let them. Returns the longest way, m.
double slide_bites(Step& e, double share) {
    double most = 0;
    const double least = kShortest * e.thread.spacing;
    for (uint32_t k = 0; k < e.s.bite.size(); ++k) {
        const uint32_t b = e.s.bite[k];
        const double lowest = e.rod.material[b - 1] + least, highest = e.rod.material[b + 1] - least;
        const double to = std::clamp(e.rod.material[b] + share * e.s.slide[k], std::min(lowest, highest), std::max(lowest, highest));
        most = std::max(most, std::abs(to - e.rod.material[b]));
        e.rod.material[b] = to;
    }
    return most;
}

// One iteration of Newton's method. Returns the largest change, m.
double iterate(Step& e) {
    const uint32_t n = e.rod.count, rows = 3 * n, bites = static_cast<uint32_t>(e.s.bite.size());
    const uint32_t knots = static_cast<uint32_t>(e.s.knot.size()), unknowns = bites + 3 * knots;
    e.s.band.assign(size_t{rows} * kWidth, 0.0);
    e.s.right.assign(size_t{rows} * (1 + unknowns), 0.0);
    add_inertia(e), add_pieces(e), add_bending(e), add_holds(e), add_planes(e);
    factor_band(e.s, rows);
    solve_band(e.s, rows, 0, e.s.right.data());
    e.s.slide.assign(unknowns, 0.0);
    if (unknowns > 0) {
        e.s.small.resize(size_t{unknowns} * (unknowns + 1));
        const auto column = [&](uint32_t j) { return &e.s.right[size_t{j + 1} * rows]; };
        for (uint32_t k = 0; k < bites; ++k) {
            choose_flow(e, k);
            if (!moves(e, k)) continue;
            set_column(e, k, column(k));
            solve_band(e.s, rows, 3 * (e.s.bite[k] - 1), column(k));
        }
        for (uint32_t q = 0; q < knots; ++q)
            for (uint32_t a = 0; a < 3; ++a) {
                double* const x = column(bites + 3 * q + a);
                x[3 * e.s.knot[q][0] + a] = 1, x[3 * e.s.knot[q][1] + a] = -1;
                solve_band(e.s, rows, 3 * std::min(e.s.knot[q][0], e.s.knot[q][1]) + a, x);
            }
        for (uint32_t k = 0; k < bites; ++k) set_small_row(e, k, unknowns, e.s.right.data(), rows);
        for (uint32_t q = 0; q < knots; ++q) set_knot_rows(e, q, unknowns, e.s.right.data(), rows);
        solve_small(e.s.small, unknowns, e.s.slide);
        for (uint32_t j = 0; j < unknowns; ++j)
            for (uint32_t r = 0; r < rows && e.s.slide[j] != 0; ++r) e.s.right[r] += e.s.slide[j] * column(j)[r];
    }
    double most = 0;
    for (uint32_t i = 0; i < n; ++i) most = std::max(most, Eigen::Map<const Vec3d>(&e.s.right[3 * i]).norm());
    const double share = most > kFarthest * e.thread.spacing ? kFarthest * e.thread.spacing / most : 1;
    for (uint32_t i = 0; i < n; ++i) e.rod.position[i] += share * Eigen::Map<const Vec3d>(&e.s.right[3 * i]);
    return std::max(share * most, slide_bites(e, share));
}

void set_masses(const Thread& thread, const Rod& rod, std::vector<double>& mass) {
    const double line = mass_per_length(thread);
    mass.assign(rod.count, 0.0);
    for (uint32_t i = 0; i + 1 < rod.count; ++i) {
        const double half = 0.5 * line * (rod.material[i + 1] - rod.material[i]);
        mass[i] += half, mass[i + 1] += half;
    }
}

// Draws the strands of a new knot together. Returns the work of that, J.
double close_knot(Step& e, uint32_t stays, uint32_t slides) {
    Vec3d& open = e.holds[e.rod.held[slides]].point;
    const double left = open.norm();
    if (!(left > 0)) return 0;
    const auto energy = [&] { return 0.5 * kKnotStiffness * (e.rod.position[slides] - e.rod.position[stays] - open).squaredNorm(); };
    const double before = energy();
    open *= std::max(0.0, 1 - kClosingSpeed * e.dt / left);
    return energy() - before;
}

// Returns the work that closes knots, J.
double begin(Step& e) {
    const uint32_t rows = static_cast<uint32_t>(e.rod.material.size()), bites = e.thread.most_bites + kMostKnots;
    const uint32_t unknowns = bites + 3 * kMostKnots;
    e.s.band.reserve(size_t{3} * rows * kWidth), e.s.right.reserve(size_t{3} * rows * (1 + unknowns));
    e.s.small.reserve(size_t{unknowns} * (unknowns + 1)), e.s.slide.reserve(unknowns), e.s.bite.reserve(bites);
    e.s.flow.reserve(bites), e.s.grip.reserve(bites), e.s.knot.reserve(kMostKnots);
    for (auto* list : {&e.s.mass, &e.s.start_material}) list->reserve(rows);
    for (auto* list : {&e.s.start, &e.s.goal}) list->reserve(rows);
    set_masses(e.thread, e.rod, e.s.mass);
    const uint32_t n = e.rod.count;
    e.s.start.assign(e.rod.position.begin(), e.rod.position.begin() + n);
    e.s.start_material.assign(e.rod.material.begin(), e.rod.material.begin() + n);
    e.s.goal.resize(n);
    for (uint32_t i = 0; i < n; ++i) e.s.goal[i] = e.dt * e.rod.velocity[i];
    e.s.bite.clear(), e.s.knot.clear();
    double work = 0;
    for (uint32_t i = 1; i + 1 < n; ++i) {
        if (is_bite(e, i)) e.s.bite.push_back(i);
        const uint32_t stays = tied_row(e.rod, e.holds, i);
        if (stays == kNone) continue;
        e.s.knot.push_back({stays, i});
        work += close_knot(e, stays, i);
    }
    e.s.flow.assign(e.s.bite.size(), 0), e.s.grip.assign(e.s.bite.size(), 1.0);
    return work;
}

// Work of a bite's friction: the difference of the energies that a unit of length has on both sides of it, times what passed.
double slide_work(const Step& e, uint32_t b, double slid) {
    const Piece lower = piece_of(e.stiffness, e.rod, b - 1), upper = piece_of(e.stiffness, e.rod, b);
    const auto per_length = [&](double t) { return t + 0.5 * t * t / e.stiffness; };
    return -std::abs(per_length(upper.tension) - per_length(lower.tension)) * std::abs(slid);
}

}  // namespace

double stretch_stiffness(const Thread& thread) { return std::numbers::pi * thread.radius * thread.radius * thread.youngs_modulus; }
double flexural_rigidity(const Thread& thread) { return 0.25 * thread.radius * thread.radius * stretch_stiffness(thread); }
double grip_of_knot(double friction, const ThreadHold& knot) {
    const double turn = 2 * std::numbers::pi * friction;
    const double pinched = knot.squared > 0 ? 2 * friction * std::exp(turn * knot.squared) : 0;
    return pinched < 1 ? std::exp(turn * knot.throws) / (1 - pinched) : std::numeric_limits<double>::infinity();
}
double mass_per_length(const Thread& thread) { return std::numbers::pi * thread.radius * thread.radius * thread.density; }

PlaneForce force_of_plane(const RodPlane& plane, const Vec3d& start, const Vec3d& now, double dt) {
    constexpr double kCreep = 1e-3;  // m/s
    PlaneForce force;
    force.depth = plane.offset - plane.normal.dot(now);
    if (!(force.depth > 0)) return force;
    const double load = kContactStiffness * force.depth;
    force.normal = load * plane.normal;
    const Vec3d moved = now - start - dt * plane.velocity, along = moved - plane.normal.dot(moved) * plane.normal;
    force.drag = plane.friction * load / std::max(along.norm(), kCreep * dt);
    force.friction = -force.drag * along;
    return force;
}

Rod rod_of(const Thread& thread, uint32_t index, ThreadState& state) {
    const auto rows = [&](auto& column) { return std::span(column).subspan(thread.rows.first, thread.rows.count); };
    const auto touching =
        std::span(state.touching).subspan(size_t{kTouchesPerPoint} * thread.rows.first, size_t{kTouchesPerPoint} * thread.rows.count);
    return {state.count[index], rows(state.material), rows(state.position), rows(state.velocity), rows(state.held), touching};
}

double tension_of(const Thread& thread, const Rod& rod, uint32_t i) { return piece_of(stretch_stiffness(thread), rod, i).tension; }

RodEnergy energy_of_rod(const Thread& thread, const Rod& rod, std::span<const ThreadHold> holds, const Vec3d& gravity) {
    RodEnergy energy;
    const double stiffness = stretch_stiffness(thread), line = mass_per_length(thread);
    const auto bite = [&](uint32_t i) { return rod.held[i] != kNone && holds[rod.held[i]].slides; };
    for (uint32_t i = 0; i + 1 < rod.count; ++i) {
        const Piece p = piece_of(stiffness, rod, i);
        energy.stretch += 0.5 * stiffness * p.rest * std::pow(p.length / p.rest - 1, 2);
        for (const uint32_t end : {i, i + 1}) {
            energy.kinetic += 0.25 * line * p.rest * rod.velocity[end].squaredNorm();
            energy.gravity -= 0.5 * line * p.rest * gravity.dot(rod.position[end]);
        }
    }
    for (uint32_t i = 1; i + 1 < rod.count; ++i) {
        if (bite(i - 1) || bite(i) || bite(i + 1)) continue;
        const double before = rod.material[i] - rod.material[i - 1], after = rod.material[i + 1] - rod.material[i];
        const Vec3d change = (rod.position[i + 1] - rod.position[i]) / after - (rod.position[i] - rod.position[i - 1]) / before;
        energy.bending += flexural_rigidity(thread) / (before + after) * change.squaredNorm();
    }
    for (uint32_t i = 0; i < rod.count; ++i) {
        const uint32_t stays = tied_row(rod, holds, i);
        if (stays == kNone) continue;
        energy.stretch += 0.5 * kKnotStiffness * (rod.position[i] - rod.position[stays] - holds[rod.held[i]].point).squaredNorm();
    }
    return energy;
}

RodStep step_rod(const Thread& thread, const Vec3d& gravity, double dt, Rod rod, std::span<ThreadHold> holds, std::span<const Vec3d> places,
                 std::span<const RodPlane> planes, RodScratch& scratch) {
    Step e{thread, gravity, dt, rod, holds, places, planes, scratch, stretch_stiffness(thread), flexural_rigidity(thread)};
    RodStep result;
    if (rod.count < 2) return result;
    result.knot_work = begin(e);
    const uint32_t n = rod.count;
    const auto solve = [&] {
        result.iterations = 0;
        for (double change = 1; change > kConverged && result.iterations < kMostIterations; ++result.iterations)
            e.iteration = result.iterations, change = iterate(e);
    };
    solve();
    if (result.iterations >= kMostIterations &&
        !scratch.bite.empty()) {  // where bites go to and fro between sliding and sticking, they stick
        std::copy_n(scratch.start.begin(), n, rod.position.begin()), std::copy_n(scratch.start_material.begin(), n, rod.material.begin());
        e.stuck = true;
        solve();
    }
    for (uint32_t i = 0; i < n; ++i) result.finite = result.finite && rod.position[i].allFinite() && std::isfinite(rod.material[i]);
    if (!result.finite) {
        std::copy_n(scratch.start.begin(), n, rod.position.begin()), std::copy_n(scratch.start_material.begin(), n, rod.material.begin());
        std::fill_n(rod.velocity.begin(), n, Vec3d::Zero());
        return result;
    }
    for (uint32_t i = 0; i < n; ++i) {
        const Vec3d moved = rod.position[i] - scratch.start[i];
        rod.velocity[i] = moved / dt;
        result.damping_work -= thread.damping * scratch.mass[i] / dt * moved.squaredNorm();
        if (i + 1 < n) result.largest_tension = std::max(result.largest_tension, tension_of(thread, rod, i));
    }
    for (const uint32_t b : scratch.bite) {
        const double slid = rod.material[b] - scratch.start_material[b];
        ThreadHold& hold = holds[rod.held[b]];
        hold.passed -= slid;
        hold.lower = tension_of(thread, rod, b - 1), hold.upper = tension_of(thread, rod, b);
        result.friction_work += slide_work(e, b, slid);
    }
    return result;
}

namespace {

void erase_row(Rod rod, uint32_t i) {
    const auto close = [&](auto& column, uint32_t each = 1) {
        std::copy(column.begin() + each * (i + 1), column.begin() + each * rod.count, column.begin() + each * i);
    };
    close(rod.material), close(rod.position), close(rod.velocity), close(rod.held), close(rod.touching, kTouchesPerPoint);
    --rod.count;
}

bool insert_row(Rod rod, uint32_t i) {
    if (rod.count >= rod.material.size()) return false;
    const auto open = [&](auto& column, uint32_t each = 1) {
        std::copy_backward(column.begin() + each * i, column.begin() + each * rod.count, column.begin() + each * (rod.count + 1));
    };
    open(rod.material), open(rod.position), open(rod.velocity), open(rod.held), open(rod.touching, kTouchesPerPoint);
    std::ranges::fill(touches_of(rod, i), kNone);
    ++rod.count;
    return true;
}

// A point in the middle of the piece from i to the next. False if there is no room.
bool halve(Rod rod, uint32_t i) {
    if (!insert_row(rod, i + 1)) return false;
    rod.material[i + 1] = 0.5 * (rod.material[i] + rod.material[i + 2]);
    rod.position[i + 1] = 0.5 * (rod.position[i] + rod.position[i + 2]);
    rod.velocity[i + 1] = 0.5 * (rod.velocity[i] + rod.velocity[i + 2]);
    rod.held[i + 1] = kNone;
    return true;
}

}  // namespace

uint32_t refine_rod(const Thread& thread, Rod rod, std::span<ThreadHold> holds) {
    uint32_t off = 0;
    const double h = thread.spacing;
    const auto bite = [&](uint32_t i) { return rod.held[i] != kNone && holds[rod.held[i]].slides; };
    for (uint32_t i = 1; i + 1 < rod.count; ++i) {
        if (!bite(i)) continue;
        if (i == 1 && !thread.knot && rod.held[0] == kNone && rod.material[1] - rod.material[0] <= 1.05 * kShortest * h) {
            holds[rod.held[1]].left = true;
            erase_row(rod, 1);
            ++off, i = 0;
            continue;
        }
        if (i > 1 && rod.held[i - 1] == kNone && rod.material[i] - rod.material[i - 1] < 0.5 * h) erase_row(rod, i - 1), --i;
        if (i + 2 < rod.count && rod.held[i + 1] == kNone && rod.material[i + 1] - rod.material[i] < 0.5 * h) erase_row(rod, i + 1);
        if (rod.material[i] - rod.material[i - 1] > 1.75 * h && halve(rod, i - 1)) ++i;
        if (i + 1 < rod.count && rod.material[i + 1] - rod.material[i] > 1.75 * h) halve(rod, i);
    }
    return off;
}

bool add_bite(const Thread& thread, double material, const Vec3d& place, uint32_t hold, Rod rod) {
    const double least = kShortest * thread.spacing;
    uint32_t i = 1;
    while (i < rod.count && rod.material[i] <= material) ++i;
    if (i >= rod.count || material - rod.material[i - 1] < least || rod.material[i] - material < least) return false;
    if (!insert_row(rod, i)) return false;
    rod.material[i] = material, rod.position[i] = place, rod.velocity[i].setZero(), rod.held[i] = hold;
    return true;
}

}  // namespace trocar
