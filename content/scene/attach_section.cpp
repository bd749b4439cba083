#include <cmath>

#include "content/scene/scene_sections.hpp"
namespace trocar {
namespace {

// Reads sphere = [x, y, z, radius], box = [lowest x, y, z, highest x, y, z] or capsule = [from x, y, z, to x,
// y, z, radius]; false if the table has none of these.
bool read_region(TomlSection& section, Region& region) {
    std::vector<double> v;
    int given = 0;
    if (section.read("sphere", 4, v)) region = {RegionKind::kSphere, {v[0], v[1], v[2]}, {v[0], v[1], v[2]}, v[3]}, ++given;
    if (section.read("box", 6, v)) region = {RegionKind::kBox, {v[0], v[1], v[2]}, {v[3], v[4], v[5]}, 0}, ++given;
    if (section.read("capsule", 7, v)) region = {RegionKind::kCapsule, {v[0], v[1], v[2]}, {v[3], v[4], v[5]}, v[6]}, ++given;
    if (given > 1) section.fail("give one of sphere, box and capsule");
    if (region.kind == RegionKind::kBox && (region.a.array() > region.b.array()).any())
        section.fail("box: its first corner must be the lowest");
    if (region.radius < 0) section.fail("a radius must not be negative");
    return given > 0;
}

}  // namespace

GroupSpec read_group(TomlSection section) {
    GroupSpec group;
    group.line = section.line();
    section.read("name", group.name);
    section.read("material", group.material);
    const bool region = read_region(section, group.region);
    section.refuse_unknown();
    if (group.name.empty()) section.fail("a [[body.group]] needs a name");
    if (!region && group.material.empty()) section.fail("group \"" + group.name + "\" needs a sphere, box, capsule or material");
    return group;
}

TissueRegionSpec read_tissue_region(TomlSection section) {
    TissueRegionSpec spec;
    spec.line = section.line();
    section.read("group", spec.group);
    section.read("field", spec.field);
    section.read("property", spec.property);
    const int given = (read_region(section, spec.region) ? 1 : 0) + (spec.group.empty() ? 0 : 1) + (spec.field.empty() ? 0 : 1);
    section.read("stiffness", spec.stiffness, 1e-6, 1e6);
    section.read("density", spec.density, 1e-6, 1e6);
    section.read("fixed", spec.fixed);
    section.refuse_unknown();
    if (given != 1) section.fail("a [[body.region]] needs one of sphere, box, capsule, group and field");
    return spec;
}

LinkSpec read_link(TomlSection section) {
    LinkSpec spec;
    LinkGroup& link = spec.link;
    spec.line = section.line();
    section.read("name", link.name);
    section.read("body", spec.body);
    section.read("to", spec.holder);
    section.read("group", spec.group);
    const bool region = read_region(section, link.region);
    spec.frame_given = section.find("frame") != nullptr;
    section.read_enum<RegionFrame>("frame", link.frame,
                                   {{"to", RegionFrame::kHolder}, {"rest", RegionFrame::kRest}, {"world", RegionFrame::kWorld}});
    section.read("within", link.within, 0, 1e3);
    section.read("stiffness", link.stiffness, 1e-9, 1e12);
    section.read("rest", link.rest, 0, 1e3);
    section.read("break_strain", link.break_strain, 1e-9, 1e12);
    section.read("from", link.begin, 0, 1e9);
    section.read("until", link.end, 0, 1e9);
    section.read("grip", spec.grip);
    section.refuse_unknown();
    if (spec.body.empty() || spec.holder.empty()) section.fail("a [[link]] needs a body and what it is linked to");
    if (link.name.empty()) link.name = spec.body + " to " + spec.holder;
    if (region && !spec.group.empty()) section.fail("link \"" + link.name + "\": give a group or a region, not both");
    if (!region && spec.group.empty() && !std::isfinite(link.within))
        section.fail("link \"" + link.name + "\": which nodes? Give a group, a sphere, a box, a capsule or within");
    if (!(link.end > link.begin)) section.fail("link \"" + link.name + "\": until must be later than from");
    return spec;
}

CutSpec read_cut(TomlSection section) {
    CutSpec cut;
    cut.line = section.line();
    section.read("name", cut.name);
    section.read("body", cut.body);
    section.read("group", cut.group);
    const bool region = read_region(section, cut.region);
    section.read("time", cut.time, 0, 1e9);
    section.refuse_unknown();
    if (cut.body.empty()) section.fail("a [[cut]] needs a body");
    if (region == !cut.group.empty()) section.fail("cut of \"" + cut.body + "\": give one of sphere, box, capsule and group");
    return cut;
}

LinkSpec read_staple(TomlSection section) {
    LinkSpec spec;
    LinkGroup& staple = spec.link;
    spec.line = section.line();
    Vec3d position = Vec3d::Zero();
    double reach = 0.01;
    section.read("name", staple.name);
    section.read("body", spec.body);
    section.read("to", spec.holder);
    section.read("place", position);
    section.read("reach", reach, 1e-9, 1e3);
    section.read("stiffness", staple.stiffness, 1e-9, 1e12);
    section.read("rest", staple.rest, 0, 1e3);
    section.read("break_strain", staple.break_strain, 1e-9, 1e12);
    section.read("time", staple.begin, 0, 1e9);
    section.read("until", staple.end, 0, 1e9);
    section.refuse_unknown();
    if (spec.body.empty() || spec.holder.empty()) section.fail("a [[staple]] needs a body and what it is stapled to");
    if (staple.name.empty()) staple.name = "staple of " + spec.body + " to " + spec.holder;
    if (!(staple.end > staple.begin)) section.fail("staple \"" + staple.name + "\": until must be later than time");
    staple.region = {RegionKind::kSphere, position, position, reach};
    staple.frame = RegionFrame::kWorld;
    spec.frame_given = true;
    staple.most = 1;
    return spec;
}

}  // namespace trocar
