#include "content/scene/scene_file.hpp"

#include <unordered_set>

#include "components/clock.hpp"
#include "content/scene/scene_sections.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

void read_contact(TomlSection section, ContactParams& contact, uint32_t& rate) {
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
    section.read_count("iterations", contact.iterations, 1, 100);
    section.read("cross_check", contact.cross_check);
    section.read_enum<ResponseShare>(
        "share", contact.share, {{"mass", ResponseShare::kMass}, {"stiffness", ResponseShare::kStiffness}, {"half", ResponseShare::kHalf}});
    section.read_enum<ResponseDirection>("direction", contact.direction,
                                         {{"local", ResponseDirection::kLocal}, {"thesis", ResponseDirection::kThesis}});
    section.refuse_unknown();
}

CameraSpec read_camera(TomlSection section) {
    CameraSpec camera;
    section.read("kind", camera.kind);
    if (camera.kind != "orbit" && camera.kind != "laparoscope") section.fail("camera kind must be orbit or laparoscope");
    section.read("target", camera.target);
    section.read("position", camera.position);
    section.read("azimuth", camera.azimuth);
    section.read("elevation", camera.elevation, -90, 90);
    section.read("distance", camera.distance, 0, 1e9);
    section.read("fov", camera.fov, 1, 170);
    section.read("wireframe", camera.wireframe);
    section.read("depth_colors", camera.depth_colors);
    section.refuse_unknown();
    return camera;
}

}  // namespace

SceneFile read_scene_file(const std::filesystem::path& path, const std::vector<Override>& overrides) {
    const std::string file = path.string();
    toml::table root = read_toml(path, "scene");
    for (const Override& o : overrides) apply_override(root, o);

    SceneFile scene;
    scene.path = path;
    scene.parameters = take_parameters(file, root);
    TomlSection top(file, root, "");
    scene.settings.name = path.stem().string();
    top.read("name", scene.settings.name);
    top.read("description", scene.settings.description);
    top.read("seconds", scene.settings.seconds, 0, 1e9);
    top.read("gravity", scene.settings.gravity);
    top.read("substep", scene.settings.substep, 1e-9, 1);
    top.read("sleep_speed", scene.settings.sleep_speed, 0, 1e3);
    top.read("sleep_after", scene.settings.sleep_after, 0, 1e6);
    if (const toml::table* contact = top.table("contact"))
        read_contact({file, *contact, "[contact]"}, scene.settings.contact, scene.contact_rate);
    if (const toml::table* camera = top.table("camera")) scene.camera = read_camera({file, *camera, "[camera]"});
    if (const toml::array* nodes = top.tables("node"))
        for (const toml::node& node : *nodes) scene.nodes.push_back(read_node(file, *node.as_table()));
    if (const toml::array* bodies = top.tables("body"))
        for (const toml::node& node : *bodies) {
            const BodySpec body = read_body(file, *node.as_table());
            if (body.scatter.asked)
                scatter_body(body, scene.bodies);
            else
                scene.bodies.push_back(body);
        }
    if (const toml::array* tools = top.tables("tool"))
        for (const toml::node& node : *tools) scene.tools.push_back(read_tool(file, *node.as_table()));
    if (const toml::array* links = top.tables("link"))
        for (const toml::node& node : *links) scene.links.push_back(read_link(file, *node.as_table()));
    if (const toml::array* staples = top.tables("staple"))
        for (const toml::node& node : *staples) scene.links.push_back(read_staple(file, *node.as_table()));
    if (const toml::array* cuts = top.tables("cut"))
        for (const toml::node& node : *cuts) scene.cuts.push_back(read_cut(file, *node.as_table()));
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

void refuse(const SceneFile& scene, uint32_t line, const std::string& reason) {
    throw InputError(scene.path.string() + ":" + std::to_string(line) + ":1: " + reason);
}

}  // namespace trocar
