#pragma once
#include <limits>
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Blood, and the watery liquid that irrigates. Viscosities at 37 degrees: blood at shear rates above 100 /s (Merrill, Physiological
// Reviews 49(4), 1969), water (CRC Handbook of Chemistry and Physics). Surface tension of blood: Hrncir & Rosina, Physiological
// Research 46(4), 1997.
struct FluidParams {
    double blood_density = 1060;       // kg/m^3
    double blood_viscosity = 3.5e-3;   // Pa s
    double water_density = 993;        // kg/m^3
    double water_viscosity = 0.69e-3;  // Pa s
    double surface_tension = 56e-3;    // N/m: sets the size of drops that fall
    Vec3d gravity{0, 0, -9.81};        // m/s^2, that of liquids: tissue whose shape is that under its weight may have none
    double blood_pressure = 12.4e3;    // Pa, mean of the arteries, 93 mmHg: what stops a bleeding has to overcome it
    Box inside;                        // m, world: drops and smoke that leave it are lost
    // Smoke. Extinction of smoke from smouldering: Seader & Einhorn, 16th Symposium (International) on Combustion, 1976. The others
    // are chosen: a coagulation of 30 W for 3 s leaves a cloud that halves the light through its middle, and that has gone in a minute.
    double smoke_yield = 1e-9;        // kg/J, of heat given to tissue that has coagulated
    double smoke_extinction = 4.4e3;  // m^2/kg
    double smoke_diffusion = 2e-5;    // m^2/s: twice this is the growth of a puff's variance
    double smoke_rise = 0.04;         // m/s, at first
    double smoke_cooling = 1.5;       // s, in which the rise falls to 1/e
    double smoke_clearing = 0.02;     // 1/s, by the exchange of the gas
    TROCAR_FIELDS(blood_density, "kg/m^3", blood_viscosity, "Pa s", water_density, "kg/m^3", water_viscosity, "Pa s", surface_tension,
                  "N/m", gravity, "m/s^2", blood_pressure, "Pa", inside, "m", smoke_yield, "kg/J", smoke_extinction, "m^2/kg",
                  smoke_diffusion, "m^2/s", smoke_rise, "m/s", smoke_cooling, "s", smoke_clearing, "1/s");
};

// A body whose surface may be wet. A cell of its film is what lies nearer to one vertex than to the others.
struct FilmBody {
    uint32_t body = kNone;
    Range cells;           // of FluidState::volume, one per vertex, padded to a multiple of 8
    Range edges;           // of FluidState::flow, one per edge of the prototype, padded likewise
    bool changes = false;  // instruments cut it or it tears: then both have room for the elements that its prototype has reserved
    TROCAR_FIELDS(body, "index of bodies", cells, "range of film cells", edges, "range of film edges", changes);
};

// Vessels that are open on a surface.
struct Wound {
    uint32_t film = kNone;                                 // index into Fluids::body
    Range spots;                                           // of Fluids::spot
    double rate = 0;                                       // m^3/s, of all when nothing seals them
    double pressure = 0;                                   // Pa, of the blood: pressed harder from outside they stop
    double area = 0;                                       // m^2, of the surface around its spots, at rest
    double reach = 0;                                      // m: a staple as near as this to a spot closes it
    double begin = 0;                                      // s
    double end = std::numeric_limits<double>::infinity();  // s
    TROCAR_FIELDS(film, "index of film bodies", spots, "range of wound spots", rate, "m^3/s", pressure, "Pa", area, "m^2", reach, "m",
                  begin, "s", end);
};

// Constant after load. Absent fluids: all empty.
struct Fluids {
    FluidParams params;
    std::vector<FilmBody> body;  // ascending by body
    std::vector<Wound> wound;
    std::vector<uint32_t> spot;  // vertices of wounds
    std::vector<double> share;   // of a wound's rate, per spot: their sum is 1
    uint32_t most_drops = 0;     // for which there is room
    uint32_t most_puffs = 0;
    uint32_t most_edges = 0;  // of edges that bleed
    TROCAR_FIELDS(params, body, wound, spot, share, most_drops, most_puffs, most_edges);
};

// Drops in the air.
struct Drops {
    std::vector<Vec3d> position;  // m, world
    std::vector<Vec3d> velocity;  // m/s
    std::vector<double> volume;   // m^3
    std::vector<double> blood;    // m^3, of it
    TROCAR_COLUMNS(position, "m", velocity, "m/s", volume, "m^3", blood, "m^3");
};

// Smoke: clouds of Gaussian density.
struct Puffs {
    std::vector<Vec3d> position;   // m, world
    std::vector<double> variance;  // m^2, along each axis
    std::vector<double> mass;      // kg
    std::vector<double> age;       // s
    TROCAR_COLUMNS(position, "m", variance, "m^2", mass, "kg", age, "s");
};

// An edge along which an instrument has opened a surface, and that bleeds at both of its vertices.
struct BleedingEdge {
    uint32_t film = 0;
    uint32_t a = 0, b = 0;
    double rate = 0;  // m^3/s, when nothing seals it
    TROCAR_FIELDS(film, "index of film bodies", a, b, rate, "m^3/s");
};

// Smoke that has come and gone, kg.
struct SmokeLedger {
    double emitted = 0;
    double sucked = 0;
    double cleared = 0;  // by the exchange of the gas, or out of the scene
    TROCAR_FIELDS(emitted, "kg", sucked, "kg", cleared, "kg");
};

// What has come and gone since the start, m^3.
struct FluidLedger {
    double bled = 0;          // out of wounds
    double irrigated = 0;     // out of nozzles
    double sucked = 0;        // into nozzles
    double sucked_blood = 0;  // of it
    double lost = 0;          // fallen out of the scene
    double lost_blood = 0;    // of it
    TROCAR_FIELDS(bled, "m^3", irrigated, "m^3", sucked, "m^3", sucked_blood, "m^3", lost, "m^3", lost_blood, "m^3");
};

struct FluidState {
    std::vector<double> volume;  // m^3, of liquid in a film cell
    std::vector<double> blood;   // m^3, of it
    std::vector<float> rise;     // m, of the liquid's surface above the vertex, when the cell was last looked at
    std::vector<float> flow;     // m^3/s over a film edge / conductance, from its first vertex to its second
    // How films hang together: constant unless a body is cut or tears.
    std::vector<uint32_t> from, to;   // per film edge: both vertices
    std::vector<float> conductance;   // per film edge: width of the border between two cells / distance of their vertices
    std::vector<float> crowding;      // per film cell: sum of its conductances
    std::vector<uint64_t> triangles;  // one per film body: hash of the triangles that these were made of
    std::vector<double> bleeding;     // m^3/s, one per wound, in the last pass
    std::vector<BleedingEdge> edge;
    std::vector<double> heat;  // J, one per action: what it had given to tissue at the last pass
    Drops drops;
    Puffs puffs;
    FluidLedger ledger;
    SmokeLedger smoke;
    TROCAR_FIELDS(volume, "m^3", blood, "m^3", rise, "m", flow, "m^3/s", from, to, conductance, crowding, triangles, bleeding,
                  "m^3/s", edge, heat, "J", drops, puffs, ledger, smoke);
};

}  // namespace trocar
