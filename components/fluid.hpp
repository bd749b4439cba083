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
    Box inside;                        // m, world: drops that leave it are lost
    TROCAR_FIELDS(blood_density, "kg/m^3", blood_viscosity, "Pa s", water_density, "kg/m^3", water_viscosity, "Pa s", surface_tension,
                  "N/m", gravity, "m/s^2", inside, "m");
};

// A body whose surface may be wet. A cell of its film is what lies nearer to one vertex than to the others.
struct FilmBody {
    uint32_t body = kNone;
    Range cells;  // of FluidState::volume, one per vertex, padded to a multiple of 8
    Range edges;  // of FluidState::flow, one per edge of the prototype, padded likewise
    TROCAR_FIELDS(body, "index of bodies", cells, "range of film cells", edges, "range of film edges");
};

// Vessels that are open on a surface.
struct Wound {
    uint32_t film = kNone;                                 // index into Fluids::body
    Range spots;                                           // of Fluids::spot
    double rate = 0;                                       // m^3/s
    double begin = 0;                                      // s
    double end = std::numeric_limits<double>::infinity();  // s
    TROCAR_FIELDS(film, "index of film bodies", spots, "range of wound spots", rate, "m^3/s", begin, "s", end);
};

// Constant after load. Absent fluids: all empty.
struct Fluids {
    FluidParams params;
    std::vector<FilmBody> body;         // ascending by body
    std::vector<uint32_t> from, to;     // per film edge: both vertices
    std::vector<float> conductance;     // per film edge: width of the border between two cells / distance of their vertices
    std::vector<float> crowding;        // per film cell: sum of its conductances
    std::vector<Wound> wound;
    std::vector<uint32_t> spot;         // vertices of wounds
    std::vector<double> share;          // of a wound's rate, per spot: their sum is 1
    uint32_t most_drops = 0;            // for which there is room
    TROCAR_FIELDS(params, body, from, to, conductance, crowding, wound, spot, share, most_drops);
};

// Drops in the air.
struct Drops {
    std::vector<Vec3d> position;  // m, world
    std::vector<Vec3d> velocity;  // m/s
    std::vector<double> volume;   // m^3
    std::vector<double> blood;    // m^3, of it
    TROCAR_COLUMNS(position, "m", velocity, "m/s", volume, "m^3", blood, "m^3");
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
    std::vector<float> rise;     // m, of the liquid's surface above the vertex, before the last substep
    std::vector<float> flow;     // m^3/s over a film edge / conductance, from its first vertex to its second
    std::vector<double> step;    // s, one per film body: of the last substep
    Drops drops;
    FluidLedger ledger;
    TROCAR_FIELDS(volume, "m^3", blood, "m^3", rise, "m", flow, "m^3/s", step, "s", drops, ledger);
};

}  // namespace trocar
