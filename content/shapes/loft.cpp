#include "content/shapes/loft.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/base/check.hpp"
namespace trocar {
namespace {

constexpr uint32_t kAround = 48;      // positions around a section at which lengths are measured
const double kRow = std::sqrt(0.75);  // height of a row of equilateral triangles

// Sides of the section, from corner to corner; a smooth section has one closed side.
struct Sides {
    std::vector<double> from;  // u of each side's start, plus the end of the last
    bool smooth = false;
    uint32_t count() const { return static_cast<uint32_t>(from.size()) - 1; }
};

Sides sides_of(const Loft& loft) {
    Sides sides;
    sides.smooth = loft.corner.empty();
    sides.from = sides.smooth ? std::vector<double>{0} : loft.corner;
    TROCAR_ASSERT(sides.from[0] == 0);
    sides.from.push_back(1);
    return sides;
}

// Measurements at one v.
struct Station {
    double v = 0;
    double along = 0;          // m, mean length of the sweep from its start
    double graded = 0;         // the same, divided by the relative edge length
    double size = 1;           // relative edge length
    std::vector<double> side;  // m, lengths of the section's sides
};

std::vector<Station> measure(const Loft& loft, const Sides& sides) {
    std::vector<Station> stations;
    std::vector<Vec3d> before, now;
    const uint32_t steps = std::max(4u, kAround / sides.count());
    for (uint32_t i = 0; i <= loft.pieces * loft.samples; ++i) {
        Station station;
        station.v = double(i) / loft.samples;
        station.size = loft.size ? loft.size(station.v) : 1.0;
        now.clear();
        for (uint32_t k = 0; k < sides.count(); ++k) {
            double length = 0;
            for (uint32_t j = 0; j <= steps; ++j) {
                const double u = sides.from[k] + (sides.from[k + 1] - sides.from[k]) * j / steps;
                now.push_back(loft.point(u == 1 ? 0.0 : u, station.v));
                if (j > 0) length += (now.back() - now[now.size() - 2]).norm();
            }
            station.side.push_back(length);
        }
        if (i > 0) {
            double length = 0;
            for (size_t j = 0; j < now.size(); ++j) length += (now[j] - before[j]).norm();
            length /= double(now.size());
            station.along = stations.back().along + length;
            station.graded = stations.back().graded + length / std::sqrt(station.size * stations.back().size);
        }
        before.swap(now);
        stations.push_back(std::move(station));
    }
    return stations;
}

struct Ring {
    double v = 0;
    double along = 0;
    std::vector<uint32_t> count;  // segments per side; empty at an end point
    double phase = 0;             // offset of a smooth section's first vertex, in segments
    uint32_t first = 0;           // index of the first vertex
    uint32_t vertices() const {
        uint32_t sum = count.empty() ? 1 : 0;
        for (const uint32_t n : count) sum += n;
        return sum;
    }
};

Station between(const Station& a, const Station& b, double t) {
    Station s = a;
    s.v += (b.v - a.v) * t;
    s.along += (b.along - a.along) * t;
    s.size += (b.size - a.size) * t;
    for (size_t k = 0; k < s.side.size(); ++k) s.side[k] += (b.side[k] - a.side[k]) * t;
    return s;
}

Ring ring_at(const Loft& loft, const Sides& sides, const Station& station, double edge) {
    Ring ring;
    ring.v = station.v;
    ring.along = station.along;
    uint32_t sum = 0;
    for (const double length : station.side) {
        ring.count.push_back(std::max(1u, static_cast<uint32_t>(std::lround(length / (edge * station.size)))));
        sum += ring.count.back();
    }
    // too few segments: add one to the side with the longest segments
    for (; sum < loft.fewest; ++sum) {
        uint32_t longest = 0;
        for (uint32_t k = 1; k < sides.count(); ++k) {
            if (station.side[k] / ring.count[k] > station.side[longest] / ring.count[longest]) longest = k;
        }
        ++ring.count[longest];
    }
    return ring;
}

// Rings for a given edge length, evenly spaced along each piece.
std::vector<Ring> place_rings(const Loft& loft, const Sides& sides, const std::vector<Station>& stations, double edge) {
    std::vector<Ring> rings;
    const double row = edge * (sides.smooth ? kRow : 1.0);
    for (uint32_t piece = 0; piece < loft.pieces; ++piece) {
        size_t low = size_t(piece) * loft.samples;
        const double from = stations[low].graded, to = stations[low + loft.samples].graded;
        const uint32_t steps = std::max(1u, static_cast<uint32_t>(std::lround((to - from) / row)));
        for (uint32_t i = 0; i < steps; ++i) {
            const double wanted = from + (to - from) * i / steps;
            while (i > 0 && stations[low + 1].graded < wanted) ++low;
            const double gap = stations[low + 1].graded - stations[low].graded;
            const double t = i > 0 && gap > 0 ? (wanted - stations[low].graded) / gap : 0.0;
            rings.push_back(ring_at(loft, sides, between(stations[low], stations[low + 1], t), edge));
            rings.back().phase = sides.smooth && rings.size() % 2 == 0 ? 0.5 : 0.0;
        }
    }
    if (!loft.ring) {
        rings.front().count.clear();
        rings.push_back({stations.back().v, stations.back().along, {}, 0, 0});
    }
    return rings;
}

uint32_t count_triangles(const std::vector<Ring>& rings, bool closed) {
    uint32_t count = 0;
    for (const Ring& ring : rings) {
        if (!ring.count.empty()) count += 2 * ring.vertices();
    }
    // every ring joins two bands, except the end points of an open sweep
    TROCAR_ASSERT(closed || (rings.front().count.empty() && rings.back().count.empty()));
    return count;
}

// Vertices of one ring, evenly spaced along every side.
void add_vertices(const Loft& loft, const Sides& sides, Ring& ring, Mesh& mesh, std::vector<double>& u_of) {
    ring.first = static_cast<uint32_t>(mesh.position.size());
    if (ring.count.empty()) {
        mesh.position.push_back(loft.point(0, ring.v));
        u_of.push_back(0);
        return;
    }
    for (uint32_t k = 0; k < sides.count(); ++k) {
        const double from = sides.from[k], to = sides.from[k + 1];
        const uint32_t steps = 8 * ring.count[k];
        std::vector<double> length(steps + 1, 0.0);
        Vec3d last = loft.point(from, ring.v);
        for (uint32_t j = 1; j <= steps; ++j) {
            const double u = from + (to - from) * j / steps;
            const Vec3d p = loft.point(u == 1 ? 0.0 : u, ring.v);
            length[j] = length[j - 1] + (p - last).norm();
            last = p;
        }
        for (uint32_t i = 0, j = 0; i < ring.count[k]; ++i) {
            const double wanted = length[steps] * (i + ring.phase) / ring.count[k];
            while (j + 1 < steps && length[j + 1] <= wanted) ++j;
            const double gap = length[j + 1] - length[j];
            const double t = wanted > 0 && gap > 0 ? (wanted - length[j]) / gap : 0.0;
            const double u = i == 0 && ring.phase == 0 ? from : from + (to - from) * (j + t) / steps;
            mesh.position.push_back(loft.point(u, ring.v));
            u_of.push_back(u);
        }
    }
}

// Corner of a band: vertex, position along its side (0..1), texture.
struct ChainPoint {
    uint32_t vertex = 0;
    double position = 0;
    Vec2 uv;
};

struct TextureScale {
    double u = 1;  // repeats around the section
    double v = 1;  // repeats per metre
};

// The vertices of one side of a ring, including the first of the next side; for an end point only that point.
std::vector<ChainPoint> chain_of(const Ring& ring, uint32_t side, const std::vector<double>& u_of, double along,
                                 const TextureScale& scale) {
    std::vector<ChainPoint> chain;
    const auto texture = [&](double u) { return Vec2{static_cast<float>(u * scale.u), static_cast<float>(along * scale.v)}; };
    if (ring.count.empty()) return {{ring.first, 0, texture(0)}};
    uint32_t offset = 0;
    for (uint32_t k = 0; k < side; ++k) offset += ring.count[k];
    const uint32_t total = ring.vertices();
    for (uint32_t i = 0; i <= ring.count[side]; ++i) {
        const uint32_t local = offset + i;
        const uint32_t vertex = ring.first + local % total;
        chain.push_back({vertex, (i + ring.phase) / ring.count[side], texture(u_of[vertex] + (local >= total ? 1 : 0))});
    }
    return chain;
}

void zip_chains(const std::vector<ChainPoint>& low, const std::vector<ChainPoint>& high, Mesh& mesh) {
    const auto add = [&](const ChainPoint& a, const ChainPoint& b, const ChainPoint& c) {
        mesh.triangle.push_back({a.vertex, b.vertex, c.vertex});
        mesh.uv.push_back({a.uv, b.uv, c.uv});
    };
    // an end point takes the texture coordinate of the middle of the opposite edge
    const auto beside = [](const ChainPoint& apex, const ChainPoint& a, const ChainPoint& b, bool end) {
        ChainPoint out = apex;
        if (end) out.uv.u = (a.uv.u + b.uv.u) / 2;
        return out;
    };
    size_t i = 0, j = 0;
    while (i + 1 < low.size() || j + 1 < high.size()) {
        // advance on the side whose next edge has its midpoint first
        const bool step_low = j + 1 == high.size() ||
                              (i + 1 < low.size() && low[i].position + low[i + 1].position <= high[j].position + high[j + 1].position);
        if (step_low) {
            add(low[i], low[i + 1], beside(high[j], low[i], low[i + 1], high.size() == 1));
            ++i;
        } else {
            add(beside(low[i], high[j], high[j + 1], low.size() == 1), high[j + 1], high[j]);
            ++j;
        }
    }
}

double signed_volume(const Mesh& mesh) {
    double volume = 0;
    const Vec3d from = mesh.position[0];
    for (const Triangle& t : mesh.triangle) {
        const Vec3d a = mesh.position[t[0]] - from, b = mesh.position[t[1]] - from, c = mesh.position[t[2]] - from;
        volume += a.dot(b.cross(c)) / 6;
    }
    return volume;
}

void turn_outward(Mesh& mesh) {
    if (signed_volume(mesh) >= 0) return;
    for (Triangle& t : mesh.triangle) std::swap(t[1], t[2]);
    for (auto& uv : mesh.uv) std::swap(uv[1], uv[2]);
}

// The edge length for which the number of triangles is nearest to the requested one.
double find_edge(const Loft& loft, const Sides& sides, const std::vector<Station>& stations, uint32_t triangles) {
    double low = stations.back().graded * 1e-5, high = stations.back().graded, best = high;
    uint32_t nearest = kNone;
    for (int i = 0; i < 60; ++i) {
        const double middle = std::sqrt(low * high);
        const uint32_t count = count_triangles(place_rings(loft, sides, stations, middle), loft.ring);
        const uint32_t miss = count > triangles ? count - triangles : triangles - count;
        if (miss < nearest) nearest = miss, best = middle;
        (count > triangles ? low : high) = middle;
    }
    return best;
}

}  // namespace

Mesh loft_surface(const Loft& loft, uint32_t triangles) {
    const Sides sides = sides_of(loft);
    const std::vector<Station> stations = measure(loft, sides);
    const double edge = find_edge(loft, sides, stations, triangles);
    std::vector<Ring> rings = place_rings(loft, sides, stations, edge);
    Mesh mesh;
    std::vector<double> u_of;
    for (Ring& ring : rings) add_vertices(loft, sides, ring, mesh, u_of);
    double girth = 0;
    for (const Station& station : stations) {
        double sum = 0;
        for (const double length : station.side) sum += length;
        girth = std::max(girth, sum);
    }
    const double total = stations.back().along;
    const TextureScale scale{std::max(1.0, std::round(girth / loft.tile)), std::max(1.0, std::round(total / loft.tile)) / total};
    for (size_t i = 0; i + 1 < rings.size() + (loft.ring ? 1 : 0); ++i) {
        const Ring &low = rings[i], &high = rings[(i + 1) % rings.size()];
        const double end = i + 1 == rings.size() ? total : high.along;
        for (uint32_t k = 0; k < sides.count(); ++k) {
            zip_chains(chain_of(low, k, u_of, low.along, scale), chain_of(high, k, u_of, end, scale), mesh);
        }
    }
    turn_outward(mesh);
    return mesh;
}

}  // namespace trocar
