// Films of liquid on surfaces against closed forms: gravity currents, a falling film, the level of a pool.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <numeric>
#include <tuple>

#include "content/shapes/dish.hpp"
#include "engine/fluid/film_setup.hpp"
#include "engine/fluid/film_shape.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "engine/world/add_body.hpp"
namespace trocar {
namespace {

constexpr double kGravity = 9.81;

// One static wet body. Gravity may be tilted instead of it.
struct Plate {
    World w;
    FilmShape shape;
    FilmShapeScratch shape_scratch;
    FilmScratch scratch;
    Vec3d down{0, 0, -1};

    explicit Plate(const Mesh& mesh, double viscosity, const Vec3d& gravity = Vec3d(0, 0, -1)) : down(gravity.normalized()) {
        add_prototype(w.meshes, mesh, Admission::kSheet);  // keeps the order of the vertices
        add_body(w, "plate", 0, Motion::kStatic);
        w.fluids.params.blood_viscosity = viscosity;
        add_film(w.meshes, 0, 0, {}, w.fluids, w.fluid_state);
        find_film_shape(surfaces_of(w), 0, w.fluids.body[0].cells.count, down, shape_scratch, shape);
    }
    const Vec3d& at(uint32_t v) const { return w.meshes.position[v]; }
    uint32_t vertices() const { return w.meshes.info[0].vertices.count; }
    double nu() const { return w.fluids.params.blood_viscosity / w.fluids.params.blood_density; }
    double& volume(uint32_t v) { return w.fluid_state.volume[v]; }
    void pour(uint32_t v, double amount) { w.fluid_state.volume[v] += amount, w.fluid_state.blood[v] += amount; }
    double all() const { return std::accumulate(w.fluid_state.volume.begin(), w.fluid_state.volume.end(), 0.0); }
    double thickness(uint32_t v) { return volume(v) * static_cast<double>(shape.inverse_area[v]); }
    void flow(double seconds) { flow_film(w.fluids.params, kGravity, seconds, shape, film_of(w.fluids, w.fluid_state, 0), scratch); }
    // In passes of a part of the time that has passed, but of at least one at 60 Hz.
    void flow_until(double end, double part) {
        for (double t = 0; t < end;) {
            const double step = std::min(std::max(1.0 / 60, part * t), end - t);
            flow(step);
            t += step;
        }
    }
    template <typename Of>
    double mean(const Of& of) {
        double sum = 0;
        for (uint32_t v = 0; v < vertices(); ++v) sum += volume(v) * of(at(v));
        return sum / all();
    }
};

// Rings of even triangles around the origin, in z = 0.
Mesh disc(uint32_t triangles, double radius) {
    Mesh mesh = make_dish(triangles);
    const double rim = std::hypot(mesh.position.back().x(), mesh.position.back().y());
    for (Vec3d& p : mesh.position) {
        const double r = std::hypot(p.x(), p.y());
        // rings at even distances
        const double polar = r > 0 ? std::asin(r / 0.181666666666666667) / std::asin(rim / 0.181666666666666667) : 0;
        p = r > 0 ? Vec3d(radius * polar * p.x() / r, radius * polar * p.y() / r, 0) : Vec3d(Vec3d::Zero());
    }
    return mesh;
}

// nx x ny x 2 triangles from x = 0 to `length`.
Mesh strip(uint32_t nx, uint32_t ny, double length, double width) {
    Mesh mesh;
    for (uint32_t i = 0; i <= nx; ++i)
        for (uint32_t j = 0; j <= ny; ++j) mesh.position.push_back({length * i / nx, width * j / ny, 0});
    for (uint32_t i = 0; i < nx; ++i)
        for (uint32_t j = 0; j < ny; ++j) {
            const uint32_t a = i * (ny + 1) + j, b = a + ny + 1;
            mesh.triangle.push_back({a, b, b + 1}), mesh.triangle.push_back({a, b + 1, a + 1});
        }
    return mesh;
}

// Huppert, J. Fluid Mech. 121, 1982: the radius is 0.894 (g V^3 / 3 nu)^(1/8) t^(1/8), the profile (1 - r^2)^(1/3); so the mean of r^2
// is 3/7 of the radius squared and the middle 4 V / (3 pi r^2) thick.
TEST(Film, SpreadsAsHuppertsAxisymmetricCurrent) {
    for (const uint32_t triangles : {1000u, 4000u}) {
        for (const double time : {30.0, 300.0}) {
            Plate later(disc(triangles, 0.1), 5.0);
            constexpr double volume = 2e-5;
            later.pour(0, volume);
            const double scale = 0.894 * std::pow(kGravity * volume * volume * volume / (3 * later.nu()), 0.125);
            later.flow_until(time, 0.01);
            const double radius = scale * std::pow(time, 0.125);
            const double found = std::sqrt(later.mean([](const Vec3d& p) { return p.squaredNorm(); }) * 7 / 3);
            double front = 0;
            for (uint32_t v = 0; v < later.vertices(); ++v)
                if (later.thickness(v) > 0.05 * later.thickness(0)) front = std::max(front, later.at(v).norm());
            const double middle = 4 * volume / (3 * std::numbers::pi * radius * radius);
            std::printf("%u triangles, %.0f s: radius %.2f mm, by its spread %.2f (%+.2f %%), front %.2f, middle %+.2f %%\n", triangles,
                        time, 1e3 * radius, 1e3 * found, 100 * (found / radius - 1), 1e3 * front, 100 * (later.thickness(0) / middle - 1));
            EXPECT_NEAR(found, radius, 0.03 * radius);
            EXPECT_NEAR(front, radius, 0.03 * radius + 0.1 / std::sqrt(triangles / 6.0)) << "to a ring";
            EXPECT_NEAR(later.thickness(0), middle, 0.03 * middle);
            EXPECT_NEAR(later.all(), volume, 1e-14 * volume);
        }
    }
}

// The same in a plane: 1.411 (g A^3 / 3 nu)^(1/5) t^(1/5) for A on one side; the mean of x^2 is 3/11 of its square.
TEST(Film, SpreadsAsHuppertsPlaneCurrent) {
    Plate plate(strip(100, 5, 0.2, 0.02), 5.0);
    constexpr double area = 4e-4;
    // the first column has cells of half the width
    for (uint32_t j = 0; j <= 5; ++j) plate.pour(j, area * 0.02 / 5 * (j % 5 == 0 ? 0.5 : 1));
    const double time = 100, length = 1.411 * std::pow(kGravity * area * area * area / (3 * plate.nu()) * time, 0.2);
    plate.flow_until(time, 0.001);
    const double found = std::sqrt(plate.mean([](const Vec3d& p) { return p.x() * p.x(); }) * 11 / 3);
    std::printf("plane: %.2f mm, found %.2f (%+.2f %%)\n", 1e3 * length, 1e3 * found, 100 * (found / length - 1));
    EXPECT_LT(length, 0.18);
    EXPECT_NEAR(found, length, 0.03 * length);
}

// Down a slope: (9 A^2 g sin / 4 nu)^(1/3) t^(1/3), thickness sqrt(nu x / (g sin t)); the mean of x is 3/5 of the length. Begun with that
// profile, of a liquid a hundred times as viscous as blood: blood would run in waves.
TEST(Film, RunsDownASlopeAsHuppertsCurrent) {
    const double sine = 0.5, cosine = std::sqrt(0.75), area = 2e-5, width = 0.02;
    Plate plate(strip(125, 5, 0.25, width), 0.35, Vec3d(sine, 0, -cosine));
    const auto time_at = [&](double x) { return x * x * x * 4 * plate.nu() / (9 * area * area * kGravity * sine); };
    const double begin = time_at(0.05), end = time_at(0.2);
    double poured = 0;
    for (uint32_t v = 0; v < plate.vertices(); ++v) {
        const double x = plate.at(v).x();
        if (x > 0.05 || plate.shape.inverse_area[v] <= 0) continue;
        const double amount = std::sqrt(plate.nu() * x / (kGravity * sine * begin)) / static_cast<double>(plate.shape.inverse_area[v]);
        plate.pour(v, amount), poured += amount;
    }
    EXPECT_NEAR(poured, area * width, 0.05 * area * width) << "by the midpoint rule";
    for (double t = begin; t < end; t += 0.25) plate.flow(std::min(0.25, end - t));
    const double scaled = 0.2 * std::cbrt(std::pow(poured / (area * width), 2)),
                 found = plate.mean([](const Vec3d&p) { return p.x(); }) * 5 / 3;
    std::printf("slope: %.2f mm after %.2f s, found %.2f (%+.2f %%)\n", 1e3 * scaled, end - begin, 1e3 * found, 100 * (found / scaled - 1));
    EXPECT_NEAR(found, scaled, 0.03 * scaled);
}

// Nusselt: a steady film carries g sin h^3 / 3 nu.
TEST(Film, IsAsThickAsNusseltsFilm) {
    constexpr double flow = 1e-5, width = 0.02, seconds = 1.0 / 60;  // m^2/s
    Plate plate(strip(100, 5, 0.2, width), 3.5e-3, Vec3d(0.5, 0, -std::sqrt(0.75)));
    const double thick = std::cbrt(3 * plate.nu() * flow / (kGravity * 0.5));
    for (int pass = 0; pass < 60 * 12; ++pass) {
        for (uint32_t j = 0; j <= 5; ++j) plate.pour(j, flow * seconds * width / 5 * (j % 5 == 0 ? 0.5 : 1));
        plate.flow(seconds);
        for (uint32_t v = 600; v <= 605; ++v) plate.volume(v) = plate.w.fluid_state.blood[v] = 0;
    }
    const double found = plate.thickness(50 * 6 + 2);
    std::printf("film: %.4f mm, found %.4f (%+.2f %%)\n", 1e3 * thick, 1e3 * found, 100 * (found / thick - 1));
    EXPECT_NEAR(found, thick, 0.01 * thick);
}

// A pool in a spherical cap has one level, that of pi z^2 (R - z/3). Poured beside the middle.
TEST(Film, APoolHasTheLevelOfACap) {
    Plate plate(make_dish(1500), 3.5e-3);
    constexpr double radius = (0.01 + 9e-4) / 0.06, volume = 1.2e-4;
    double level = 0.01;
    for (int i = 0; i < 60; ++i) level = std::sqrt(volume / (std::numbers::pi * (radius - level / 3)));
    const auto source = static_cast<uint32_t>(std::ranges::find_if(plate.w.meshes.position, [](const Vec3d& p) { return p.x() > 0.05; }) -
                                              plate.w.meshes.position.begin());
    for (int pass = 0; pass < 60 * 40; ++pass) {
        if (pass < 240) plate.pour(source, volume / 240);
        plate.flow(1.0 / 60);
    }
    double low = 1, high = 0, wet = 0;
    for (uint32_t v = 0; v < plate.vertices(); ++v) {
        const double h = plate.thickness(v);
        if (plate.at(v).z() > level - 2e-3) continue;
        const double surface =
            plate.at(v).z() + static_cast<double>(liquid_rise(static_cast<float>(h), plate.shape.upright[v], plate.shape.relief[v]));
        low = std::min(low, surface), high = std::max(high, surface), wet += plate.volume(v);
    }
    std::printf("level %.3f mm, found %.3f to %.3f, %.1f %% of the liquid more than 2 mm below\n", 1e3 * level, 1e3 * low, 1e3 * high,
                100 * wet / volume);
    EXPECT_NEAR(low, level, 0.02 * level);
    EXPECT_NEAR(high, level, 0.02 * level);
    EXPECT_NEAR(plate.all(), volume, 1e-13 * volume);
}

// A step between two levels of a frictionless pool parts into two waves of sqrt(g h) with the mean level between them (Stoker, Water
// Waves, 1957, for small steps).
TEST(Film, AStepBetweenLevelsRunsBothWays) {
    constexpr double deep = 0.0102, shallow = 0.0098, length = 0.4, width = 0.02, time = 0.3, middle = length / 2;
    Plate plate(strip(200, 5, length, width), 1e-7);
    for (uint32_t v = 0; v < plate.vertices(); ++v)
        if (plate.shape.inverse_area[v] > 0)
            plate.pour(v, (plate.at(v).x() < middle ? deep : shallow) / static_cast<double>(plate.shape.inverse_area[v]));
    for (int pass = 0; pass < 18; ++pass) plate.flow(time / 18);
    // what has left the deep side: the wave that runs into it lowers it by half the step
    double left = 0;
    for (uint32_t v = 0; v < plate.vertices(); ++v)
        if (plate.at(v).x() < middle - 1e-6 && plate.shape.inverse_area[v] > 0)
            left += deep / static_cast<double>(plate.shape.inverse_area[v]) - plate.volume(v);
    const double wave = left / (width * 0.5 * (deep - shallow)) / time, expected = std::sqrt(kGravity * 0.01);
    const double between = plate.thickness(100 * 6 + 2);
    std::printf("wave %.4f m/s, found %.4f (%+.2f %%), level between %.4f mm\n", expected, wave, 100 * (wave / expected - 1),
                1e3 * between);
    EXPECT_NEAR(wave, expected, 0.03 * expected);
    EXPECT_NEAR(between, 0.01, 0.03 * (deep - shallow));
}

// Blood of 1 mm at rest on a slope of 30 degrees comes to run as dq/dt = g h sin - 3 nu q / h^2 lets it: 1 - exp(-3 nu t / h^2) of
// Nusselt's flow.
TEST(Film, ComesToRunAgainstFriction) {
    constexpr double thick = 1e-3, seconds = 1.0 / 60;
    Plate plate(strip(200, 5, 0.8, 0.02), 3.5e-3, Vec3d(0.5, 0, -std::sqrt(0.75)));
    for (uint32_t v = 0; v < plate.vertices(); ++v)
        if (plate.shape.inverse_area[v] > 0) plate.pour(v, thick / static_cast<double>(plate.shape.inverse_area[v]));
    const Film film = film_of(plate.w.fluids, plate.w.fluid_state, 0);
    for (int pass = 1; pass <= 24; ++pass) {
        plate.flow(seconds);
        if (pass % 6 != 0) continue;
        double flow = 0, width = 0;  // through the middle, in units of the distance of vertices
        for (size_t e = 0; e < film.from.size(); ++e) {
            if (film.from[e] / 6 != 100 || film.to[e] / 6 != 101) continue;
            flow += static_cast<double>(film.conductance[e] * film.flow[e]), width += static_cast<double>(film.conductance[e]) * 0.004;
        }
        const double full = kGravity * 0.5 * thick * thick * thick / (3 * plate.nu());
        const double expected = full * -std::expm1(-3 * plate.nu() * pass * seconds / (thick * thick)), found = flow / width;
        std::printf("%.2f s: %.3f of the flow, found %.3f\n", pass * seconds, expected / full, found / full);
        EXPECT_NEAR(found, expected, 0.03 * full);
    }
}

// Every block of edges takes the steps that it needs itself: a film of blood in a bowl ends where 16 times as many passes leave it, and
// most blocks take one step in a pass. Breaks when steps of a whole pass take the flow at their start, or when one cell hurries all.
TEST(Film, StepsAreShortOnlyWhereTheyMustBe) {
    const auto run = [](int parts, double& steps) {
        Plate plate(make_dish(4000), 3.5e-3);
        for (uint32_t v = 0; v < plate.vertices(); ++v)
            if (plate.shape.inverse_area[v] > 0) plate.pour(v, 3e-4 / static_cast<double>(plate.shape.inverse_area[v]));
        steps = 0;
        for (int pass = 0; pass < 60 * parts; ++pass) plate.flow(1.0 / 60 / parts), steps += plate.scratch.steps;
        steps *= 8.0 / 60 / static_cast<double>(plate.w.fluid_state.from.size());
        return std::sqrt(plate.mean([](const Vec3d& p) { return p.head<2>().squaredNorm(); }));
    };
    double steps = 0, many = 0;
    const double found = run(1, steps), fine = run(16, many);
    std::printf("mean distance from the axis %.3f mm, in short passes %.3f; %.2f steps a pass, %.1f\n", 1e3 * found, 1e3 * fine, steps,
                many);
    EXPECT_NEAR(found, fine, 2e-4);
    EXPECT_LT(steps, 2.5);
}

// A film of 0.3 mm runs down a slope from one cell to the next and on to a third: dh/dt = r (h_before^3 - h^3), r = g sin / (3 nu length)
// of a cell, integrated here by Runge and Kutta's method. The flow into the second begins with a call; that into the third later in it,
// with steps that are short at first and grow. Breaks when the first step counts the flow before it, which is none.
TEST(Film, RunsFromCellToCellInStepsThatGrow) {
    using Three = Eigen::Array3d;
    constexpr double thick = 3e-4, length = 0.1, sine = 0.5;
    for (const auto& [calls, upper, lower] : {std::tuple(4, 0.01, 0.1), std::tuple(8, 0.005, 0.02)}) {
        Plate plate(strip(4, 5, 4 * length, 0.05), 3.5e-3, Vec3d(sine, 0, -std::sqrt(0.75)));
        for (uint32_t v = 6; v < 12; ++v) plate.pour(v, thick / static_cast<double>(plate.shape.inverse_area[v]));
        const double rate = kGravity * sine / (3 * plate.nu() * length), seconds = 0.5 / (rate * thick * thick), dt = seconds / 1000;
        for (int i = 0; i < calls; ++i) plate.flow(seconds / calls);
        const auto change = [&](const Three& h) { return Three(rate * (Three(0, h[0], h[1]).cube() - h.cube())); };
        Three h(thick, 0, 0);
        for (int i = 0; i < 1000; ++i) {
            const Three k1 = change(h), k2 = change(h + dt / 2 * k1), k3 = change(h + dt / 2 * k2), k4 = change(h + dt * k3);
            h += dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
        }
        for (uint32_t cell = 0; cell < 3; ++cell) {
            const double found = plate.thickness((cell + 1) * 6 + 2), near = cell < 2 ? upper : lower;
            std::printf("%d calls, cell %u: %.4f um, found %.4f (%+.2f %%)\n", calls, cell, 1e6 * h[cell], 1e6 * found,
                        100 * (found / h[cell] - 1));
            EXPECT_NEAR(found, h[cell], near * h[cell]);
        }
    }
}

// What flows carries its colour: blood and water mix, and neither is made. Breaks when dye and volume move apart.
TEST(Film, KeepsBloodAndWater) {
    Plate plate(disc(600, 0.05), 3.5e-3);
    plate.pour(0, 3e-6);
    plate.volume(40) += 5e-6;
    for (int pass = 0; pass < 300; ++pass) plate.flow(1.0 / 60);
    const std::vector<double>& blood = plate.w.fluid_state.blood;
    EXPECT_NEAR(std::accumulate(blood.begin(), blood.end(), 0.0), 3e-6, 1e-19);
    EXPECT_NEAR(plate.all(), 8e-6, 1e-19);
    for (uint32_t v = 0; v < plate.vertices(); ++v) {
        EXPECT_GE(blood[v], 0);
        EXPECT_LE(blood[v], plate.volume(v) * (1 + 1e-5) + 1e-18) << v;
    }
}

}  // namespace
}  // namespace trocar
