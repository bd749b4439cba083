#include "content/scene/scene_file.hpp"

#include <numbers>
#include <unordered_set>

#include "components/clock.hpp"
#include "content/scene/scene_sections.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

ContactParams read_contact(TomlSection section, uint32_t& rate) {
    ContactParams contact;
    section.read_count("rate", rate, 1, 1000);
    if (!is_contact_rate(rate)) section.fail("rate must be 30, 60, 90 ... 240 (Hz), a whole number of passes a picture");
    section.read("tolerance", contact.tolerance, 1e-12, 1e3);
    section.read("cell_edges", contact.cell_edges, 0.01, 1000);
    section.read("push_speed", contact.push_speed, 0, 1e3);
    section.read_enum<DeepResponse>("deep", contact.deep, {{"none", DeepResponse::kNone}, {"last_free", DeepResponse::kLastFree}});
    section.read_enum<TreeSearch>("search", contact.search, {{"own", TreeSearch::kOwn}, {"embree", TreeSearch::kEmbree}});
    section.read("faces", contact.faces);
    section.read("contours", contact.contours);
    section.read("regions", contact.regions);
    section.read("hulls", contact.hulls);
    section.read_count("iterations", contact.iterations, 1, 100);
    section.read("cross_check", contact.cross_check);
    section.read_enum<ResponseShare>(
        "share", contact.share, {{"mass", ResponseShare::kMass}, {"stiffness", ResponseShare::kStiffness}, {"half", ResponseShare::kHalf}});
    section.read_enum<ResponseDirection>("direction", contact.direction,
                                         {{"local", ResponseDirection::kLocal}, {"thesis", ResponseDirection::kThesis}});
    section.refuse_unknown();
    return contact;
}

// The key's value, or the default, in degrees; as rad.
double read_angle(TomlSection& section, std::string_view key, double degrees, double lowest, double highest) {
    section.read(key, degrees, lowest, highest);
    return degrees * std::numbers::pi / 180;
}

Lens read_fog(TomlSection section) {
    Lens lens;
    section.read("lens", lens.temperature, -40, 50);
    section.read("cavity", lens.cavity, -40, 50);
    section.read("humidity", lens.humidity, 0, 1);
    section.read("time_constant", lens.time_constant, 1e-3, 1e9);
    section.read("transfer", lens.transfer, 0, 1);
    section.read("half_clear", lens.half_clear, 1e-9, 1);
    section.read("wipe", lens.wipe, 0, 1);
    section.refuse_unknown();
    return lens;
}

// Keys of a laparoscope that a body holds.
void read_held_laparoscope(TomlSection& section, SceneFile& scene) {
    Camera& camera = scene.camera;
    section.read_direction("shaft", camera.shaft);
    section.read_direction("up", camera.mark);
    camera.optic = read_angle(section, "optic_deg", 0, 0, 80);
    camera.optic_roll = read_angle(section, "optic_roll", 0, -1e300, 1e300);
    camera.roll = read_angle(section, "roll", 0, -1e300, 1e300);
    section.read("level", camera.level);
    section.read("light", camera.light, 1e-3, 1e3);
    section.read_table("fog", scene.lenses.lens, [&](TomlSection fog) { return std::vector<Lens>{read_fog(std::move(fog))}; });
    if (!(camera.shaft.cross(camera.mark).norm() > 1e-6)) section.fail("up must not be along the shaft");
    for (Lens& lens : scene.lenses.lens) lens.point = camera.position;
}

void read_camera(TomlSection section, SceneFile& scene) {
    Camera& camera = scene.camera;
    PictureParams& picture = scene.picture;
    scene.camera_line = section.line();
    camera.position.setZero(), camera.distance = 0;  // 0: fitted to the scene
    section.read_enum<CameraKind>("kind", camera.kind, {{"orbit", CameraKind::kOrbit}, {"laparoscope", CameraKind::kLaparoscope}});
    section.read("target", camera.target);
    section.read("position", camera.position);
    camera.azimuth = read_angle(section, "azimuth", 30, -1e300, 1e300);
    camera.elevation = read_angle(section, "elevation", 25, -90, 90);
    section.read("distance", camera.distance, 0, 1e9);
    camera.field_of_view = read_angle(section, "fov", 35, 1, 170);
    section.read("lamp", camera.lamp, -1, 1);
    section.read("follow", scene.camera_body);
    const bool laparoscope = camera.kind == CameraKind::kLaparoscope;
    if (!laparoscope && (camera.lamp != 0 || !scene.camera_body.empty())) section.fail("follow and lamp are for kind = \"laparoscope\"");
    if (!scene.camera_body.empty()) read_held_laparoscope(section, scene);
    section.read("wireframe", picture.wireframe);
    section.read("depth_colors", picture.depth_colours);
    section.refuse_unknown();
}

SceneFile read_scene(toml::table root, const std::filesystem::path& path, const std::vector<Override>& overrides) {
    const std::string file = path.string();
    for (const Override& o : overrides) apply_override(root, o);

    SceneFile scene;
    scene.path = path;
    scene.parameters = take_parameters(file, root);
    TomlSection top(file, root);
    scene.settings.name = path.stem().string();
    top.read("name", scene.settings.name);
    top.read("description", scene.settings.description);
    top.read("seconds", scene.settings.seconds, 0, 1e9);
    top.read("gravity", scene.settings.gravity);
    top.read("substep", scene.settings.substep, 1e-9, 1);
    top.read("sleep_speed", scene.settings.sleep_speed, 0, 1e3);
    top.read("sleep_after", scene.settings.sleep_after, 0, 1e6);
    top.read_table("contact", scene.settings.contact, [&](TomlSection section) { return read_contact(section, scene.contact_rate); });
    const toml::table no_keys, *camera = top.table("camera");
    read_camera({file, camera ? *camera : no_keys, "[camera]"}, scene);
    top.read_list("node", scene.nodes, read_node);
    std::vector<BodySpec> bodies;
    top.read_list("body", bodies, read_body);
    for (const BodySpec& body : bodies) {
        if (body.scatter.asked)
            scatter_body(body, scene.bodies);
        else
            scene.bodies.push_back(body);
    }
    top.read_list("tool", scene.tools, read_tool);
    top.read_list("link", scene.links, read_link);
    top.read_list("staple", scene.links, read_staple);
    top.read_list("cut", scene.cuts, read_cut);
    top.read_table("fluid", scene.fluid, read_fluid);
    top.read_list("wound", scene.wounds, read_wound);
    top.read_list("thread", scene.threads, read_thread);
    top.read_count("staples", scene.staples, 0, 1e6);
    std::vector<std::string> parameters;
    for (const SceneParameter& parameter : scene.parameters) parameters.push_back(parameter.name);
    top.refuse_unknown(parameters);

    std::unordered_set<std::string_view> names;
    for (const BodySpec& body : scene.bodies) {
        if (!names.insert(body.name).second)
            throw InputError(file + ":" + std::to_string(body.line) + ":1: two bodies are named \"" + body.name + "\"");
    }
    return scene;
}

}  // namespace

SceneFile read_scene_file(const std::filesystem::path& path, const std::vector<Override>& overrides) {
    return read_scene(read_toml(path, "scene"), path, overrides);
}
std::string scene_text_with(const std::filesystem::path& path, const std::vector<Override>& overrides) {
    toml::table root = read_toml(path, "scene");
    for (const Override& o : overrides) apply_override(root, o);
    std::ostringstream text;
    text << root << "\n";
    return text.str();
}

SceneFile read_scene_text(const std::string& text, const std::filesystem::path& path, const std::vector<Override>& overrides) {
    return read_scene(read_toml_text(text, path.string()), path, overrides);
}

void refuse(const SceneFile& scene, uint32_t line, const std::string& reason) {
    throw InputError(scene.path.string() + ":" + std::to_string(line) + ":1: " + reason);
}

}  // namespace trocar
