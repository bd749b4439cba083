#include "systems/app/capture/capture_export.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "content/write/save_mesh.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/mesh/surface_mesh.hpp"
#include "engine/tissue/spring_step.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/pictures/picture_writer.hpp"
#include "systems/app/player/player_page.hpp"
#include "systems/app/report/report_page.hpp"
#include "systems/app/report/svg_plot.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

PointField velocity_field(const World& world, uint32_t body, uint32_t vertices) {
    PointField field{"velocity", 3, {}};
    for (uint32_t v = 0; v < vertices; ++v)
        for (const double component : vertex_velocity(surfaces_of(world), body, v)) field.values.push_back(static_cast<float>(component));
    return field;
}

// The contacts of one pass per vertex of every body; the vertices of a body begin at `first`.
struct ContactMarks {
    std::vector<uint32_t> first;
    std::vector<float> depth, contact;
};

ContactMarks mark_contacts(const World& world) {
    ContactMarks marks;
    uint32_t vertices = 0;
    for (const uint32_t mesh : world.bodies.mesh) {
        marks.first.push_back(vertices);
        vertices += world.meshes.info[mesh].vertices.count;
    }
    marks.depth.assign(vertices, 0.0f);
    marks.contact.assign(vertices, 0.0f);
    const Contacts& c = world.contacts;
    for (size_t i = 0; i < c.body.size(); ++i) {
        const auto mark = [&](uint32_t v) {
            const uint32_t row = marks.first[c.body[i]] + v;
            marks.contact[row] = 1;
            marks.depth[row] = std::max(marks.depth[row], static_cast<float>(-c.distance[i]));
        };
        for (const uint32_t v : c.vertex[i]) mark(v);
        if (c.third[i] != kNone) mark(c.third[i]);
    }
    return marks;
}

// Particle with the largest weight for a vertex of an embedded surface.
uint32_t node_under(const Solids& solids, uint32_t prototype, uint32_t vertex) {
    const uint32_t row = solids.info[prototype].skin.first + vertex;
    const auto& weight = solids.embedding_weight[row];
    return solids.embedding_node[row][static_cast<size_t>(std::max_element(weight.begin(), weight.end()) - weight.begin())];
}

}  // namespace

std::vector<float> vertex_strain(const World& world, uint32_t body) {
    const uint32_t vertices = world.meshes.info[world.bodies.mesh[body]].vertices.count;
    std::vector<float> strain(vertices, 0.0f);
    if (!is_deformable(world.bodies, body)) return strain;
    const SpringInfo& info = world.springs.info[world.bodies.mesh[body]];
    const uint32_t prototype = world.bodies.mesh[body], first = world.bodies.particles[body].first + info.skin;
    const SpringStep s = bind_body(world.springs, world.bodies, world.anchors, world.particles, body,
                                   world.tears.body.empty() ? nullptr : &world.torn_springs);
    const auto position = [&](uint32_t v) {
        const Float4& o = world.particles.offset[first + v];
        return Vec3d(o.x, o.y, o.z);
    };
    for (uint32_t row = 0; row < vertices; ++row) {
        const uint32_t v = info.skin > 0 ? node_under(world.solids, prototype, row) : row;
        const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
        double sum = 0, springs = 0;
        for (uint32_t c = s.slice_column[slice]; c < s.slice_column[slice + 1]; ++c) {
            const uint32_t far_end = s.neighbour[c * kSliceWidth + lane];
            const double rest = s.rest_length[c * kSliceWidth + lane];
            if (far_end == v || rest <= 0) continue;
            sum += std::abs((position(far_end) - position(v)).norm() / rest - 1);
            ++springs;
        }
        if (springs > 0) strain[row] = static_cast<float>(sum / springs);
    }
    return strain;
}

namespace {

constexpr const char* kAllBodies = "bodies";
constexpr const char* kVtpNote =
    "Points, velocity, strain and stress are of the end of the pass; depth and contact were found at its start, where the points were "
    "in the pass before.";

std::vector<PointField> point_fields(const World& world, const ContactMarks& marks, uint32_t body, uint32_t vertices) {
    const auto rows = [&](const std::vector<float>& of_all) {
        const auto first = of_all.begin() + marks.first[body];
        return std::vector<float>(first, first + vertices);
    };
    std::vector<PointField> fields{{"depth", 1, rows(marks.depth)},
                                   {"contact", 1, rows(marks.contact)},
                                   velocity_field(world, body, vertices),
                                   {"strain", 1, vertex_strain(world, body)}};
    PointField stress{"stress", 1, fields.back().values};
    for (float& value : stress.values) value *= static_cast<float>(world.bodies.tissue[body].youngs_modulus);
    fields.push_back(std::move(stress));
    return fields;
}

std::string pass_file(const std::string& name, uint64_t pass) {
    return name + format("_%06llu.vtp", static_cast<unsigned long long>(pass));
}

void write_each_body(const World& world, uint64_t pass, const fs::path& folder) {
    const ContactMarks marks = mark_contacts(world);
    for (uint32_t body = 0; body < world.bodies.mesh.size(); ++body) {
        if (is_away(world.spawning, body)) continue;
        const Mesh mesh = surface_mesh(surfaces_of(world), body);
        const auto fields = point_fields(world, marks, body, static_cast<uint32_t>(mesh.position.size()));
        save_vtp(mesh, fields, folder / pass_file(world.bodies.name[body], pass), kVtpNote);
    }
}

// Writes all bodies as one surface with an extra field naming the body of each point. Omits materials and
// texture coordinates: their indices are per body.
void write_bodies(const World& world, uint64_t pass, const fs::path& folder) {
    const ContactMarks marks = mark_contacts(world);
    Mesh all;
    std::vector<PointField> fields{{"body", 1, {}}};
    for (uint32_t body = 0; body < world.bodies.mesh.size(); ++body) {
        if (is_away(world.spawning, body)) continue;
        const Mesh mesh = surface_mesh(surfaces_of(world), body);
        const uint32_t first = static_cast<uint32_t>(all.position.size()), vertices = static_cast<uint32_t>(mesh.position.size());
        all.position.insert(all.position.end(), mesh.position.begin(), mesh.position.end());
        for (const Triangle& t : mesh.triangle) all.triangle.push_back({t[0] + first, t[1] + first, t[2] + first});
        fields[0].values.resize(first + vertices, static_cast<float>(body));
        const auto own = point_fields(world, marks, body, vertices);
        if (fields.size() == 1)
            for (const PointField& field : own) fields.push_back({field.name, field.components, {}});
        for (size_t k = 0; k < own.size(); ++k)
            fields[k + 1].values.insert(fields[k + 1].values.end(), own[k].values.begin(), own[k].values.end());
    }
    save_vtp(all, fields, folder / pass_file(kAllBodies, pass), kVtpNote);
}

// Hz, contact rate of a stretch.
uint32_t contact_rate_of(const Capture::Stretch& stretch) {
    uint32_t rate = Clock{}.contact_rate;
    for (const CaptureArray& a : stretch.state.arrays)
        if (a.name == "clock.contact_rate" && a.bytes.size() == sizeof rate) std::memcpy(&rate, a.bytes.data(), sizeof rate);
    return std::max(1u, rate);
}

struct VtpExport {
    const fs::path& folder;
    bool per_body;
    std::vector<std::string> body;
    std::vector<std::pair<uint64_t, double>> pass;  // pass number and time at its end, s
};

void write_series(const VtpExport& e, const std::string& name) {
    std::string out = "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n<Collection>\n";
    for (const auto& [pass, seconds] : e.pass) {
        const std::string file = pass_file(name, pass);
        if (!fs::exists(e.folder / file)) continue;  // body was inactive
        out += format("<DataSet timestep=\"%.3f\" part=\"0\" file=\"%s\"/>\n", seconds, escape_html(file).c_str());
    }
    write_whole_file(e.folder / (name + ".pvd"), out + "</Collection>\n</VTKFile>\n");
}

}  // namespace

std::string capture_csv(const Capture& capture) {
    std::string out = "pass,time_s,frame_ms,detection_ms,response_ms,depth_m,force_n,contacts,inside_vertices,state_hash";
    for (const std::string& stage : capture.header.stages) out += "," + stage + "_ms";
    out += "\n";
    for (const Capture::Stretch& stretch : capture.stretches) {
        const uint32_t rate = contact_rate_of(stretch);
        for (const CaptureStep& s : stretch.steps) {
            out += format("%llu,%.3f,%.6g,%.6g,%.6g,%.9g,%.9g,%llu,%llu,%016llx", static_cast<unsigned long long>(s.pass),
                          static_cast<double>(pass_tick(s.pass, rate)) * 1e-3, s.frame_ms, s.detection_ms, s.response_ms, s.depth, s.force,
                          static_cast<unsigned long long>(s.contacts), static_cast<unsigned long long>(s.inside_vertices),
                          static_cast<unsigned long long>(s.state_hash));
            for (const uint64_t ns : s.stage_ns) {
                out += format(",%.6g", static_cast<double>(ns) * 1e-6);
            }
            out += "\n";
        }
    }
    return out;
}

std::string capture_trace(const Capture& capture) {
    nlohmann::json events = nlohmann::json::array();
    double at = 0;  // us
    for (const Capture::Stretch& stretch : capture.stretches) {
        for (const CaptureStep& s : stretch.steps) {
            const double begin = at;
            for (size_t i = 0; i < s.stage_ns.size() && i < capture.header.stages.size(); ++i) {
                const double duration = static_cast<double>(s.stage_ns[i]) * 1e-3;
                if (duration <= 0) continue;
                events.push_back({{"name", capture.header.stages[i]}, {"ph", "X"}, {"pid", 1}, {"tid", 1}, {"ts", at}, {"dur", duration}});
                at += duration;
            }
            at = std::max(at, begin + s.frame_ms * 1e3);
            events.push_back(
                {{"name", "pass " + std::to_string(s.pass)}, {"ph", "X"}, {"pid", 1}, {"tid", 0}, {"ts", begin}, {"dur", at - begin}});
        }
    }
    return nlohmann::json{{"traceEvents", std::move(events)}, {"displayTimeUnit", "ms"}}.dump();
}

void export_vtp(const Capture& capture, const fs::path& folder, bool per_body) {
    prepare_folder(folder);
    VtpExport state{folder, per_body, {}, {}};
    const auto each = [](void* user, Frame& frame, const CaptureStep& step) {
        VtpExport& e = *static_cast<VtpExport*>(user);
        e.body = frame.world().bodies.name;
        e.pass.emplace_back(step.pass, static_cast<double>(frame.world().clock.tick) * 1e-3);
        (e.per_body ? write_each_body : write_bodies)(frame.world(), step.pass, e.folder);
    };
    replay_capture(capture, {each, &state});
    if (per_body) {
        for (const std::string& body : state.body) write_series(state, body);
        return;
    }
    write_series(state, kAllBodies);
    std::string names = "body,name\n";
    for (size_t body = 0; body < state.body.size(); ++body) names += std::to_string(body) + "," + csv_field(state.body[body]) + "\n";
    write_whole_file(folder / "bodies.csv", names);
}

std::string capture_page(const Capture& capture) {
    const CaptureHeader& h = capture.header;
    std::optional<PlayerRecorder> recorder;
    replay_capture(capture, {[](void* user, Frame& frame, const CaptureStep& step) {
                                 auto& player = *static_cast<std::optional<PlayerRecorder>*>(user);
                                 if (player)
                                     player->after_pass(frame, step.stage_ns);
                                 else
                                     player.emplace(frame, true, step.stage_ns);
                             },
                             &recorder});
    std::string facts = "<h1>" + escape_html(h.scene) + "</h1><p>Captured by trocar " + escape_html(h.version) + " (" +
                        escape_html(h.reason) + ") on " + escape_html(h.machine) + ", " + std::to_string(capture.passes()) + " passes" +
                        (capture.damage.empty() ? "" : "; incomplete: it " + escape_html(capture.damage)) + ".</p>\n";
    if (const std::vector<uint8_t>& png = capture.picture.png; !png.empty())
        facts += "<p><img alt=\"picture\" src=\"data:image/png;base64," + base64(png) + "\"><br>The end of pass " +
                 std::to_string(capture.picture.pass) + ", in the capture.</p>\n";
    return html_page(h.scene, facts + (recorder ? player_section(*recorder, h.scene, h.camera) : "<p>It holds no pass.</p>"));
}

size_t export_pictures(const Capture& capture, const fs::path& folder) {
    prepare_folder(folder);
    const World world = world_at(capture, 0);
    PictureParams params;
    params.wireframe = capture.header.wireframe, params.depth_colours = capture.header.depth_colours;
    PictureWriter pictures(params, capture.header.camera, world.meshes, folder);
    replay_capture(capture, {[](void* user, Frame& frame, const CaptureStep&) {
                                 if (frame.times().picture) static_cast<PictureWriter*>(user)->take(frame.world().picture);
                             },
                             &pictures});
    pictures.finish_film();
    return pictures.files().size();
}

}  // namespace trocar
