#include <algorithm>
#include <cmath>

#include "content/scene/scene_sections.hpp"
namespace trocar {

FluidSpec read_fluid(TomlSection section) {
    FluidSpec spec;
    spec.line = std::max(1u, section.line());  // 0 where --set made the table: there is one all the same
    FluidParams& p = spec.params;
    section.read("density", p.blood_density, 1, 1e5);
    section.read("viscosity", p.blood_viscosity, 1e-6, 1e3);
    section.read("water_density", p.water_density, 1, 1e5);
    section.read("water_viscosity", p.water_viscosity, 1e-6, 1e3);
    section.read("surface_tension", p.surface_tension, 1e-6, 10);
    section.read("blood_pressure", p.blood_pressure, 0, 1e9);
    section.read("smoke_yield", p.smoke_yield, 0, 1);
    section.read("smoke_extinction", p.smoke_extinction, 0, 1e9);
    section.read("smoke_diffusion", p.smoke_diffusion, 0, 1e3);
    section.read("smoke_rise", p.smoke_rise, 0, 1e3);
    section.read("smoke_cooling", p.smoke_cooling, 1e-6, 1e9);
    section.read("smoke_clearing", p.smoke_clearing, 0, 1e6);
    section.read("gravity", spec.params.gravity);
    spec.gravity_given = section.find("gravity") != nullptr;
    section.read("bodies", spec.bodies);
    section.read_count("drops", spec.drops, 0, 100'000);
    section.refuse_unknown();
    return spec;
}

WoundSpec read_wound(TomlSection section) {
    WoundSpec spec;
    spec.line = section.line();
    section.read("name", spec.name);
    section.read("body", spec.body);
    if (spec.body.empty()) section.fail("a [[wound]] needs body: the name of what bleeds");
    spec.place = Vec3d::Constant(std::nan(""));
    section.read("place", spec.place);
    if (!spec.place.allFinite()) section.fail("a [[wound]] needs place = [x, y, z] (m, world, at load)");
    section.read("radius", spec.radius, 0, 1e3);
    double rate = 0;  // ml/min
    section.read("rate", rate, 0, 1e6);
    spec.rate = rate * 1e-6 / 60;
    section.read("pressure", spec.pressure, 0, 1e9);
    section.read("diameter", spec.diameter, 0, 1);
    section.read("length", spec.length, 0, 1e3);
    section.read("from", spec.from, 0, 1e9);
    section.read("until", spec.until, 0, 1e300);
    const bool vessel = spec.pressure > 0 && spec.diameter > 0 && spec.length > 0;
    const bool any = spec.pressure > 0 || spec.diameter > 0 || spec.length > 0;
    if ((rate > 0) == any || (any && !vessel))
        section.fail("a [[wound]] needs either rate (ml/min), or pressure (Pa), diameter and length (m) of the vessel");
    if (!(spec.until > spec.from)) section.fail("a [[wound]] needs until after from");
    section.refuse_unknown();
    return spec;
}

}  // namespace trocar
