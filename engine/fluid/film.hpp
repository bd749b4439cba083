#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/fluid.hpp"
namespace trocar {

// Shape of one body's surface at one moment: elements per vertex.
struct FilmShape {
    std::vector<float> height;        // m, of the vertex against gravity, from an origin that all share
    std::vector<float> inverse_area;  // 1/m^2, of the cell; 0 where there is none
    std::vector<float> upright;       // cosine of the surface's slope, 0 where it overhangs
    std::vector<float> relief;        // m, difference of heights within the cell: liquid that is deeper stands level
};

// One body's part of the state and of the constant data.
struct Film {
    std::span<const uint32_t> from, to;  // both vertices of every edge, in the order of order_edges, to a multiple of kFilmBlock
    std::span<const float> conductance;  // per edge
    std::span<const float> crowding;     // per vertex, sum of conductances
    std::span<double> volume;            // m^3, per vertex
    std::span<double> blood;             // m^3, of it
    std::span<float> rise;               // m, of the liquid's surface above the vertex, when the cell was last looked at
    std::span<float> flow;               // m^3/s, per edge: see FluidState
};

// Edges that are looked at together.
inline constexpr uint32_t kFilmBlock = 8;

struct FilmScratch {
    // What drives the liquid of a cell: height of the vertex, of the liquid's surface above it, thickness, drag (3 nu).
    struct alignas(16) Cell {
        float height, lead, thickness, drag;
    };
    // What a cell gives away: share of blood, 1 / volume.
    struct alignas(8) Donor {
        float share, inverse_volume;
    };
    struct alignas(16) Amount {
        double volume, blood;  // m^3
    };
    struct alignas(8) Moved {
        float volume, blood;  // m^3, over an edge
    };
    std::vector<Cell> cell;
    std::vector<Donor> donor;
    std::vector<Amount> amount;
    std::vector<float> standing, fullness;  // per cell, of its shape: 1 / cosine of the slope, 2 / relief
    std::vector<float> out, kept;           // per cell: m^3 that would leave it, and the part of it that does
    std::vector<uint8_t> need;              // per cell: see need_of, and kPool where liquid stands; 3 more for gathers
    std::vector<uint32_t> giver;            // per edge: the cell that the flow leaves
    std::vector<Moved> moved;               // per edge
    static constexpr uint8_t kPool = 128, kAsleep = 255;
    std::vector<uint8_t> due;    // per block of edges: tick at which it steps next, or kAsleep
    std::vector<uint8_t> ticks;  // of that step, if not shortened
    // Ticks of its longest step, by the waves when it woke. Pools that deepen later in the call are held by the part of a cell that may
    // leave it over an edge: asking for waves again at each step changed one step in a thousand and cost 15 %.
    std::vector<uint8_t> most;
    std::vector<uint8_t> beside;  // per block of cells: an end of an edge below is in it
    std::vector<uint32_t> awake;  // first edges of the blocks that step again
    std::vector<uint32_t> block;  // first edges of the blocks that step at this tick
    std::vector<uint32_t> cells;  // first cells of blocks with an end of these
    uint64_t waves = 0;           // the needs of all cells, in eight bytes
    bool spreads = false;         // a cell has become wet
    uint32_t steps = 0;           // of blocks of edges in the last call, with those that were tried and shortened
};

// Films thinner than this stay where they are: a tenth of a micrometre, where surface forces hold them. m
inline constexpr float kThinnestFilm = 1e-7f;
// Of an edge in a call of flow_film, a power of two up to 32. Where that is too few, waves on pools are damped and cells empty later. With
// 32 in a pass of 1/60 s the centre of 0.3, 1 and 2 mm of blood all over a liver of 20,000 triangles is after a second within 0.1, 0.2
// and 0.4 mm of where 2,048 leave it, on a way of 30 to 60; with 8 within 0.1, 7 and 21 mm.
inline constexpr uint32_t kMostSubsteps = 32;

// Lets a film flow for `seconds`. Over an edge between two cells the flow q per width of their border obeys
//     dq/dt = -g h ds/dx - 3 nu q / h^2,
// h the thickness, s the height of the liquid's surface, nu the kinematic viscosity of the mixture where it comes from. Thin films
// follow lubrication theory, q = -g h^3 / (3 nu) ds/dx (Huppert, J. Fluid Mech. 121, 1982), thick ones and pools shallow water
// with laminar friction, without advection of momentum (Bates et al., J. Hydrology 387, 2010): a dam
// that breaks on dry ground lets a bore run, not Ritter's thin front. Every block of edges takes steps as short as waves and the emptying
// of cells need there, all blocks at pools equal ones. Liquid is neither made nor lost but by rounding, and no cell holds less than
// nothing. Fluidities of blood and water add by volume (Bingham, Fluidity and Plasticity, 1922). No allocation once the scratch has its
// size.
void flow_film(const FluidParams& params, double gravity, double seconds, const FilmShape& shape, const Film& film, FilmScratch& scratch);

// Height of the liquid's surface above a vertex, m. A film adds its thickness across the slope; liquid that is deeper than the
// relief of its cell stands level and fills the cell from below.
float liquid_rise(float thickness, float upright, float relief);
// How far liquid stands level: 0 = a film on a slope, 1 = a pool.
float levelness(float thickness, float relief);

// The edges of a mesh in an order in which neighbours in the list have no vertex in common, wherever that is possible; `order` is
// a permutation of them.
void order_edges(std::span<const std::array<uint32_t, 2>> edge, uint32_t vertices, std::span<uint32_t> order);

// Width of the border between two cells over the distance of their vertices, per edge of the mesh: half the sum of the cotangents
// of the angles that face the edge, 0 if negative (Meyer et al. 2003: the dual of a Delaunay triangulation). Slivers, which would
// need short steps, conduct at most four times what regular triangles of their cells' area do.
void compute_conductances(std::span<const Vec3d> position, std::span<const std::array<uint32_t, 3>> triangle,
                          std::span<const std::array<uint32_t, 3>> triangle_edge, std::span<const std::array<uint32_t, 2>> edge,
                          std::span<float> conductance);

}  // namespace trocar
