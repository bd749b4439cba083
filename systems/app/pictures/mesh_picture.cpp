#include "systems/app/pictures/mesh_picture.hpp"

#include <algorithm>
#include <numbers>

#include "content/mend/admission.hpp"
#include "content/mend/mesh_box.hpp"
#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/draw/text_overlay.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "systems/app/console/format.hpp"
#include "systems/output/render.hpp"
namespace trocar {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr OverlayColour kLabelColour{236, 240, 244, 255};
constexpr OverlayColour kSizeColour{150, 162, 176, 255};

// Adds a copy centred at the origin with a diagonal of one metre, for any units; returns the original box.
Box add_normalised(const Mesh& mesh, Meshes& meshes) {
    const MeshJudgement judgement = judge_mesh(mesh, false);
    if (judgement.admitted_as == Admission::kRefused) {
        throw InputError(mesh.name + ": nothing to draw: " + judgement.reason);
    }
    const Box box = box_of_faces(mesh, mesh.triangle);
    Mesh copy = mesh;
    const Vec3d middle = 0.5 * box.min + 0.5 * box.max;
    const double diagonal = (box.max - box.min).stableNorm();
    for (Vec3d& p : copy.position) p = (p - middle) / diagonal;
    add_prototype(meshes, copy, judgement.admitted_as);
    // computed from the faces: vertices without a face do not count
    meshes.info.back().box = {(box.min - middle) / diagonal, (box.max - middle) / diagonal};
    return box;
}

// Aims and moves the camera so that the vertices fill the picture. The bounding box gave only a first guess.
void tighten_camera(const MeshView& mesh, uint32_t width, uint32_t height, Camera& camera) {
    constexpr double kFill = 0.86;  // of the picture's smaller side
    for (int round = 0; round < 4; ++round) {
        const View view = make_view(camera, mesh.info->box, width, height);
        const Vec3d forward = Vec3(view.forward.data()).cast<double>(), right = Vec3(view.right.data()).cast<double>(),
                    up = Vec3(view.up.data()).cast<double>();
        Box seen;
        for (const Triangle& t : mesh.triangle) {
            for (const uint32_t v : t) {
                const Vec3d p = mesh.position[v] - view.eye;
                const double depth = p.dot(forward);
                if (!(depth > 0)) continue;
                const Vec3d at(p.dot(right) / (depth * view.tan_x), p.dot(up) / (depth * view.tan_y), 0);
                seen.min = seen.min.cwiseMin(at);
                seen.max = seen.max.cwiseMax(at);
            }
        }
        const Vec3d middle = (seen.min + seen.max) / 2, half = (seen.max - seen.min) / 2;
        if (!half.allFinite() || !(half.maxCoeff() > 0)) return;
        camera.target += camera.distance * (middle.x() * view.tan_x * right + middle.y() * view.tan_y * up);
        camera.distance *= half.head<2>().maxCoeff() / kFill;
    }
}

void paste(const Image& tile, uint32_t x, uint32_t y, Image& out) {
    for (uint32_t row = 0; row < tile.height; ++row) {
        std::copy_n(tile.rgba.begin() + size_t(row) * tile.width * 4, size_t(tile.width) * 4,
                    out.rgba.begin() + (size_t(y + row) * out.width + x) * 4);
    }
}

// Number of grid columns that gives the largest 4:3 tiles.
uint32_t choose_columns(uint32_t count, uint32_t width, uint32_t height) {
    uint32_t best = 1;
    double largest = 0;
    for (uint32_t columns = 1; columns <= count; ++columns) {
        const uint32_t rows = (count + columns - 1) / columns;
        const double size = std::min(double(width) / columns, 4.0 / 3 * height / rows);
        if (size > largest) largest = size, best = columns;
    }
    return best;
}

std::string size_text(const Box& box) {
    const Vec3d size = box.max - box.min;
    return format("%.4g x %.4g x %.4g", size.x(), size.y(), size.z());
}

void write_texts(const MeshPictureParams& params, const MeshTile& tile, const Box& box, Image& image) {
    const uint32_t scale = std::clamp(image.height / 240, 1u, 4u);
    const int32_t edge = static_cast<int32_t>(5 * scale);
    const auto fits = [&](const std::string& text) { return text_width(text, scale) + 2 * static_cast<uint32_t>(edge) <= image.width; };
    draw_text(image, edge, edge, scale, kLabelColour, tile.label);
    const std::string size = params.sizes ? size_text(box) : "";
    // a truncated number would be misread
    if (fits(size)) draw_text(image, edge, static_cast<int32_t>(image.height - 12 * scale), scale, kSizeColour, size);
}

}  // namespace

std::vector<MeshTile> four_views(uint32_t mesh) {
    return {{mesh, -90 * kDegree, 0, "front"},
            {mesh, 0, 0, "side"},
            {mesh, -90 * kDegree, 90 * kDegree, "top"},
            {mesh, -60 * kDegree, 28 * kDegree, "oblique"}};
}

Image draw_meshes(const MeshPictureParams& params, std::span<const Mesh> meshes, std::span<const MeshTile> tiles) {
    TROCAR_ASSERT(!tiles.empty());
    Meshes prototypes;
    std::vector<Box> boxes;
    for (const Mesh& mesh : meshes) boxes.push_back(add_normalised(mesh, prototypes));
    const uint32_t count = static_cast<uint32_t>(tiles.size());
    const uint32_t columns = choose_columns(count, params.width, params.height);
    const uint32_t rows = (count + columns - 1) / columns;
    PictureParams picture;
    picture.width = params.width / columns;
    picture.height = params.height / rows;
    if (picture.width == 0 || picture.height == 0) throw InputError("the picture is too small for its tiles");
    picture.wireframe = params.wireframe;
    picture.text = picture.witnesses = picture.tools = false;
    GlRenderer renderer(prototypes);
    RenderScratch scratch;
    Image out{params.width, params.height, {}}, part;
    for (size_t i = 0; i < size_t(params.width) * params.height; ++i) out.rgba.insert(out.rgba.end(), {30, 34, 40, 255});
    for (uint32_t i = 0; i < count; ++i) {
        const MeshTile& tile = tiles[i];
        PictureSnapshot snapshot;
        PictureBody body;
        body.mesh = tile.mesh;
        body.box = prototypes.info[tile.mesh].box;
        snapshot.body.push_back(body);
        Camera camera;
        camera.up = params.up;
        camera.azimuth = tile.azimuth;
        camera.elevation = tile.elevation;
        fit_camera(snapshot, picture.width, picture.height, camera);
        tighten_camera(mesh_view(prototypes, tile.mesh), picture.width, picture.height, camera);
        // seen from the side the floor is a line, and from below it hides the mesh
        picture.ground = tile.elevation > 5 * kDegree && tile.elevation < 85 * kDegree;
        render_picture(picture, camera, snapshot, renderer, scratch, part);
        write_texts(params, tile, boxes[tile.mesh], part);
        paste(part, i % columns * picture.width, i / columns * picture.height, out);
    }
    return out;
}

}  // namespace trocar
