#include <cmath>

#include "content/scene/scene_sections.hpp"
namespace trocar {
namespace {

std::vector<Vec3d> read_points(TomlSection& section, std::string_view key) {
    std::vector<Vec3d> points;
    const toml::node* node = section.find(key);
    if (!node) return points;
    const toml::array* list = node->as_array();
    for (size_t i = 0; list && i < list->size(); ++i) {
        const toml::array* entry = (*list)[i].as_array();
        Vec3d point = Vec3d::Constant(std::nan(""));
        for (size_t k = 0; entry && entry->size() == 3 && k < 3; ++k)
            point[static_cast<Eigen::Index>(k)] = (*entry)[k].value<double>().value_or(std::nan(""));
        if (!point.allFinite() || point.cwiseAbs().maxCoeff() > 1e3)
            section.fail((*list)[i], std::string(key) + ": a point is [x, y, z] (m)");
        points.push_back(point);
    }
    if (points.empty()) section.fail(*node, std::string(key) + " is a list of points [x, y, z] (m)");
    return points;
}

}  // namespace

ThreadSpec read_thread(TomlSection section) {
    ThreadSpec spec;
    spec.line = section.line();
    Thread& t = spec.thread;
    t.contact = false;
    section.read("name", t.name);
    if (t.name.empty()) section.fail("a [[thread]] needs a name");
    section.read("tool", spec.tool);
    spec.end = Vec3d::Constant(std::nan(""));
    section.read("end", spec.end);
    spec.end_given = spec.end.allFinite();
    if (spec.end_given && spec.end.cwiseAbs().maxCoeff() > 1e3) section.fail("end is a point [x, y, z] (m) of the tool's body");
    if (spec.end_given && spec.tool.empty()) section.fail("end is where the thread hangs on its tool: it needs tool");
    spec.path = read_points(section, "path");
    if (spec.path.size() < (spec.tool.empty() ? 2u : 1u))
        section.fail("a [[thread]] needs path: points [x, y, z] (m, world) from its first end on");
    section.read("fixed", spec.fixed);
    section.read("knot", t.knot);
    section.read("contact", t.contact);
    double diameter = 2 * t.radius;
    section.read("diameter", diameter, 1e-6, 0.1);
    t.radius = 0.5 * diameter;
    section.read("youngs_modulus", t.youngs_modulus, 1, 1e13);
    section.read("density", t.density, 1, 1e5);
    section.read("damping", t.damping, 0, 1e6);
    section.read("friction", t.friction, 0, 100);
    section.read("spacing", t.spacing, 1e-5, 1);
    section.read("grip", spec.grip, 1e-9, 1e12);
    section.read_count("bites", spec.bites, 0, 1000);
    Vec3d colour(t.colour[0], t.colour[1], t.colour[2]);
    section.read("color", colour);
    for (size_t k = 0; k < 3; ++k) {
        t.colour[k] = colour[static_cast<Eigen::Index>(k)];
        if (!(t.colour[k] >= 0 && t.colour[k] <= 1)) section.fail("color: red, green and blue are from 0 to 1");
    }
    section.refuse_unknown();
    return spec;
}

}  // namespace trocar
