#include "content/shapes/shape_library.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "content/mend/remeshing.hpp"
#include "content/mend/smoothing.hpp"
#include "content/shapes/dish.hpp"
#include "content/shapes/inguinal_region.hpp"
#include "content/shapes/instrument_shapes.hpp"
#include "content/shapes/plain_shapes.hpp"
#include "content/shapes/ring_and_sac.hpp"
#include "content/shapes/surface_texture.hpp"
#include "content/shapes/tube_organs.hpp"
#include "content/shapes/wall_and_mesh.hpp"
#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

constexpr uint32_t kMostTriangles = 1'000'000;

struct Recipe {
    std::string_view name;
    uint32_t fewest;  // fewest triangles
    Mesh (*make)(uint32_t triangles, uint64_t seed, Looks looks);
    std::string_view description;
};

Vec3d volume_centroid(const Mesh& mesh) {
    double volume = 0;
    Vec3d moment = Vec3d::Zero();
    for (const Triangle& t : mesh.triangle) {
        const Vec3d &a = mesh.position[t[0]], &b = mesh.position[t[1]], &c = mesh.position[t[2]];
        const double six =
            a.x() * (b.y() * c.z() - b.z() * c.y()) + a.y() * (b.z() * c.x() - b.x() * c.z()) + a.z() * (b.x() * c.y() - b.y() * c.x());
        volume += six;
        moment += six * (a + b + c);
    }
    return moment / (4 * volume);
}

Image painted(Looks looks, Image (*paint)(uint64_t seed), uint64_t seed) { return looks == Looks::kPainted ? paint(seed) : Image{}; }

Material surface_material(std::string name, std::array<float, 3> specular, float shininess, Image image) {
    Material material;
    material.name = std::move(name);
    material.diffuse = {1, 1, 1};
    material.specular = specular;
    material.shininess = shininess;
    material.image = std::move(image);
    return material;
}

Mesh make_organ(const ImplicitShape& shape, uint32_t triangles, double tile, Material material) {
    Mesh mesh = mesh_implicit(shape, triangles);
    const Vec3d centre = volume_centroid(mesh);
    for (Vec3d& p : mesh.position) p -= centre;
    project_uv(tile, mesh);
    mesh.material.push_back(std::move(material));
    return mesh;
}

Mesh make_liver(uint32_t triangles, uint64_t seed, Looks looks) {
    return make_organ(liver_shape(seed), triangles, 0.08,
                      surface_material("liver", {0.35f, 0.33f, 0.32f}, 0.45f, painted(looks, paint_liver, seed)));
}

Mesh make_kidney(uint32_t triangles, uint64_t seed, Looks looks) {
    return make_organ(kidney_shape(seed), triangles, 0.06,
                      surface_material("kidney", {0.4f, 0.38f, 0.37f}, 0.5f, painted(looks, paint_kidney, seed)));
}

Mesh with_material(Mesh mesh, Material material) {
    mesh.material.push_back(std::move(material));
    return mesh;
}

Material plain_material(std::string name, std::array<float, 3> diffuse, float specular, float shininess) {
    Material material = surface_material(std::move(name), {specular, specular, specular}, shininess, {});
    material.diffuse = diffuse;
    return material;
}

Material steel(uint64_t seed, Looks looks) {
    return surface_material("steel", {0.6f, 0.6f, 0.6f}, 0.6f, painted(looks, paint_steel, seed));
}

Mesh make_stomach(uint32_t triangles, uint64_t seed, Looks looks) {
    return make_organ(stomach_shape(seed), triangles, 0.09,
                      surface_material("stomach", {0.36f, 0.33f, 0.33f}, 0.5f, painted(looks, paint_stomach, seed)));
}

Mesh textured_gallbladder(uint32_t triangles, uint64_t seed, Looks looks) {
    return with_material(make_gallbladder(triangles, seed),
                         surface_material("gallbladder", {0.4f, 0.4f, 0.36f}, 0.55f, painted(looks, paint_gallbladder, seed)));
}

Mesh textured_bowel(uint32_t triangles, uint64_t seed, Looks looks) {
    return with_material(make_bowel(triangles, seed),
                         surface_material("small bowel", {0.4f, 0.36f, 0.36f}, 0.55f, painted(looks, paint_bowel, seed)));
}

Mesh textured_wall(uint32_t triangles, uint64_t seed, Looks looks) {
    Mesh mesh = make_hernia_wall(WallSize{}, triangles);
    project_uv(0.07, mesh);
    mesh.material = {surface_material("muscle", {0.25f, 0.23f, 0.22f}, 0.35f, painted(looks, paint_muscle, seed)),
                     surface_material("fascia", {0.25f, 0.24f, 0.23f}, 0.35f, painted(looks, paint_fascia, seed)),
                     surface_material("peritoneum", {0.38f, 0.36f, 0.35f}, 0.5f, painted(looks, paint_peritoneum, seed))};
    return mesh;
}

Mesh textured_mesh(uint32_t triangles, uint64_t seed, Looks looks) {
    Material material = surface_material("polypropylene", {0.25f, 0.25f, 0.25f}, 0.4f, painted(looks, paint_polypropylene, seed));
    material.transparency = 0.3f;
    return with_material(make_surgical_mesh(divide_mesh(triangles)), std::move(material));
}

Mesh textured_fine_mesh(uint32_t triangles, uint64_t seed, Looks looks) {
    Material material = surface_material("polypropylene", {0.25f, 0.25f, 0.25f}, 0.4f, painted(looks, paint_polypropylene, seed));
    material.transparency = 0.3f;
    return with_material(make_fine_mesh(triangles), std::move(material));
}

template <Mesh (*make)(uint32_t triangles)>
Mesh of_steel(uint32_t triangles, uint64_t seed, Looks looks) {
    Mesh mesh = with_material(make(triangles), steel(seed, looks));
    // the shaft of an instrument with several pieces is insulated
    if (!mesh.triangle_material.empty()) {
        mesh.material.push_back(plain_material("insulation", {0.03f, 0.03f, 0.035f}, 0.25f, 0.4f));
    }
    return mesh;
}

Mesh textured_sac(uint32_t triangles, uint64_t seed, Looks looks) {
    return with_material(make_sac(triangles),
                         surface_material("peritoneum", {0.38f, 0.36f, 0.35f}, 0.5f, painted(looks, paint_peritoneum, seed)));
}

Mesh textured_ring(uint32_t triangles, uint64_t seed, Looks looks) {
    return with_material(make_ring(triangles),
                         surface_material("fascia", {0.25f, 0.24f, 0.23f}, 0.35f, painted(looks, paint_fascia, seed)));
}

Mesh textured_inguinal_wall(uint32_t triangles, uint64_t seed, Looks looks) {
    Mesh mesh = make_inguinal_wall(triangles);
    project_uv(0.07, mesh);
    mesh.material = {surface_material("fascia", {0.25f, 0.24f, 0.23f}, 0.35f, painted(looks, paint_fascia, seed)),
                     surface_material("fascia", {0.25f, 0.24f, 0.23f}, 0.35f, painted(looks, paint_fascia, seed)),
                     surface_material("muscle", {0.45f, 0.42f, 0.40f}, 0.5f, painted(looks, paint_muscle, seed))};
    return mesh;
}

Mesh textured_peritoneum(uint32_t triangles, uint64_t seed, Looks looks) {
    Mesh mesh = make_peritoneum(triangles);
    project_uv(0.07, mesh);
    // parts of one look: groups of a scene name them
    for (const char* name : {"peritoneum", "rim", "sac"}) {
        mesh.material.push_back(surface_material(name, {0.38f, 0.36f, 0.35f}, 0.5f, painted(looks, paint_peritoneum, seed)));
        mesh.material.back().transparency = 0.25f;
    }
    return mesh;
}

Mesh coloured_cord(uint32_t triangles, uint64_t, Looks) {
    return with_material(with_material(make_cord(triangles), plain_material("vas", {0.90f, 0.84f, 0.72f}, 0.5f, 0.6f)),
                         plain_material("spermatic vessels", {0.50f, 0.16f, 0.20f}, 0.5f, 0.6f));
}

Mesh coloured_epigastric_vessels(uint32_t triangles, uint64_t, Looks) {
    return with_material(make_epigastric_vessels(triangles), plain_material("vessel", {0.62f, 0.12f, 0.12f}, 0.5f, 0.6f));
}

Mesh coloured_iliac_vessels(uint32_t triangles, uint64_t, Looks) {
    return with_material(with_material(make_iliac_vessels(triangles), plain_material("artery", {0.66f, 0.22f, 0.18f}, 0.5f, 0.6f)),
                         plain_material("vein", {0.28f, 0.22f, 0.38f}, 0.5f, 0.6f));
}

Mesh coloured_pubic_bone(uint32_t triangles, uint64_t, Looks) {
    return with_material(with_material(make_pubic_bone(triangles), plain_material("bone", {0.80f, 0.70f, 0.58f}, 0.3f, 0.4f)),
                         plain_material("ligament", {0.94f, 0.92f, 0.86f}, 0.6f, 0.6f));
}

Mesh clear_cannula(uint32_t triangles, uint64_t, Looks) {
    Material plastic = plain_material("clear plastic", {0.55f, 0.68f, 0.78f}, 0.5f, 0.6f);
    plastic.transparency = 0.7f;
    return with_material(make_cannula(triangles), std::move(plastic));
}

Mesh textured_box(uint32_t triangles, uint64_t, Looks) {
    return with_material(make_box(triangles), plain_material("box", {0.65f, 0.62f, 0.55f}, 0.1f, 0.2f));
}

Mesh textured_sheet(uint32_t triangles, uint64_t, Looks) {
    return with_material(make_sheet(triangles), plain_material("sheet", {0.80f, 0.84f, 0.90f}, 0.1f, 0.2f));
}

Mesh textured_sphere(uint32_t triangles, uint64_t, Looks) {
    return with_material(make_sphere(triangles), plain_material("sphere", {0.62f, 0.6f, 0.66f}, 0.2f, 0.3f));
}

Mesh textured_capsule(uint32_t triangles, uint64_t, Looks) {
    return with_material(make_capsule(triangles), plain_material("capsule", {0.62f, 0.6f, 0.66f}, 0.2f, 0.3f));
}

Mesh textured_hull(uint32_t triangles, uint64_t seed, Looks) {
    return with_material(make_hull(triangles, seed), plain_material("hull", {0.58f, 0.57f, 0.54f}, 0.05f, 0.15f));
}

Mesh textured_table(uint32_t triangles, uint64_t seed, Looks looks) {
    return with_material(make_table(triangles), surface_material("drape", {0.04f, 0.04f, 0.04f}, 0.1f, painted(looks, paint_drape, seed)));
}

Mesh textured_dish(uint32_t triangles, uint64_t, Looks) {
    return with_material(make_dish(triangles), plain_material("steel", {0.42f, 0.44f, 0.46f}, 0.3f, 0.5f));
}

constexpr std::array<Recipe, 32> kRecipes{{
    {"liver", 100, make_liver, "human liver, 0.21 x 0.15 x 0.12 m; right lobe -x, head +y, belly +z; centred"},
    {"kidney", 100, make_kidney, "human kidney, 0.11 x 0.06 x 0.045 m; poles along x, hilum -y; centred"},
    {"gallbladder", 200, textured_gallbladder, "human gallbladder with neck and stump of the duct; fundus -y, belly +z"},
    {"stomach", 100, make_stomach, "human stomach, J-shaped; fundus +x +y, pylorus -x, belly +z; centred"},
    {"bowel", 200, textured_bowel, "loop of small bowel, 28 mm wide, 0.42 m long, meandering in the plane of x and y"},
    {"hernia_wall", 200, textured_wall, "abdominal wall, 0.2 x 0.16 x 0.018 m, an oval defect through it; outside +z"},
    {"surgical_mesh", 100, textured_mesh, "open sheet with hexagonal pores, 0.15 x 0.1 m in z = 0; centred"},
    {"fine_mesh", 50, textured_fine_mesh, "open sheet, 0.15 x 0.1 m in z = 0, pores in its texture alone; centred"},
    {"probe", 300, of_steel<make_probe>, "palpation probe, 0.167 m; tip sphere of 7 mm centred at the origin, shaft along +z"},
    {"grasper", 1000, of_steel<make_grasper>, "grasper of 5 mm, jaws open by 30 degrees about x; pivot at the origin, +z"},
    {"grasper_jaw", 400, of_steel<make_grasper_jaw>, "one toothed jaw, 19 mm; pivot at the origin, tip +z, teeth -y"},
    {"scissors", 400, of_steel<make_scissors>, "scissors of 5 mm, open by 30 degrees about y; pivot at the origin, +z"},
    {"scissor_blade", 100, of_steel<make_scissor_blade>, "one blade, 21 mm, flat side y = 0, edge +x; tip +z"},
    {"needle", 200, of_steel<make_needle>, "half-circle suture needle, 26 mm long, 0.66 mm thick; in z = 0, point -x"},
    {"tacker", 500, of_steel<make_tacker>, "tacker tube of 5 mm with a spiral tack half out of it; rim at z = 0, +z"},
    {"cannula", 200, clear_cannula, "clear tube of a 10 mm trocar, 60 mm long, wall 1 mm, a funnel of 20 mm at +z; centred"},
    {"ring", 100, textured_ring, "torus of 24 mm bore, 8 mm thick, in z = 0; centred"},
    {"sac", 200, textured_sac, "open sheet: pouch of 40 x 50 mm, round end -z, its neck bent outwards in z = 0"},
    {"inguinal_wall", 200, textured_inguinal_wall,
     "inside of the groin with the inguinal ring, 0.22 x 0.17 x 0.01 m; ring at the origin, lateral +x, up +z, belly -y"},
    {"peritoneum", 400, textured_peritoneum, "open sheet before inguinal_wall, in its frame, with a hernia sac through the ring"},
    {"cord", 200, coloured_cord, "vas deferens and spermatic vessels on inguinal_wall, in its frame"},
    {"epigastric_vessels", 100, coloured_epigastric_vessels, "a tube of 3.2 mm on inguinal_wall, in its frame"},
    {"iliac_vessels", 200, coloured_iliac_vessels, "artery and vein below inguinal_wall's ring, in its frame"},
    {"pubic_bone", 100, coloured_pubic_bone, "ramus of the pubis with Cooper's ligament on its crest, in the frame of inguinal_wall"},
    {"sphere", 20, textured_sphere, "sphere of diameter 1 m, centred"},
    {"box", 12, textured_box, "cube of 1 m, centred"},
    {"capsule", 48, textured_capsule, "capsule, 1 m long, 0.5 m thick, along z, centred"},
    {"hull", 20, textured_hull, "convex stone in a cube of 1 m, irregular by the seed, centred"},
    {"sheet", 50, textured_sheet, "open sheet: square of 1 m in z = 0, facing +z, centred"},
    {"table", 12, textured_table, "draped slab, 0.6 x 0.6 x 0.02 m, thin along z, centred"},
    {"dish", 6, textured_dish, "open bowl, 0.2 m across, 0.03 m deep, part of a sphere; lowest point at the origin, open to +z"},
    {"plane", 12, textured_table, "another name for table"},
}};

const Recipe* find_recipe(std::string_view name) {
    const auto found = std::find_if(kRecipes.begin(), kRecipes.end(), [&](const Recipe& r) { return r.name == name; });
    return found == kRecipes.end() ? nullptr : &*found;
}

}  // namespace

std::vector<std::string> shape_names() {
    std::vector<std::string> names;
    for (const Recipe& recipe : kRecipes) names.emplace_back(recipe.name);
    return names;
}

std::string_view describe_shape(std::string_view name) {
    const Recipe* recipe = find_recipe(name);
    return recipe ? recipe->description : std::string_view();
}

Mesh make_shape(std::string_view name, uint32_t triangles, uint64_t seed, Looks looks) {
    const Recipe* recipe = find_recipe(name);
    if (!recipe) {
        std::string known;
        for (const Recipe& r : kRecipes) known += (known.empty() ? "" : ", ") + std::string(r.name);
        throw InputError("no shape \"" + std::string(name) + "\"; there are " + known);
    }
    if (triangles < recipe->fewest || triangles > kMostTriangles) {
        throw InputError("shape \"" + std::string(name) + "\": " + std::to_string(triangles) + " triangles asked, " +
                         std::to_string(recipe->fewest) + " to " + std::to_string(kMostTriangles) + " can be made");
    }
    Mesh mesh = recipe->make(triangles, seed, looks);
    mesh.name = name;
    return mesh;
}

Mesh mesh_implicit(const ImplicitShape& shape, uint32_t triangles) {
    TROCAR_ASSERT(triangles >= 100);
    // estimate from a coarse contour: the number of triangles grows with the inverse square of the spacing
    const double coarse = (shape.box.max - shape.box.min).maxCoeff() / 40;
    const double seen = static_cast<double>(contour(sample_shape(shape, coarse), 0.0).triangle.size());
    if (seen == 0) throw InputError(shape.name + ": the shape has no surface inside its box");
    const double wanted = std::max(2.0 * triangles, 12000.0);
    const double spacing = coarse * std::sqrt(seen / wanted);
    Mesh mesh = contour(sample_shape(shape, spacing), 0.0);
    smooth_taubin({.rounds = 2}, mesh.triangle, mesh.position);
    const SurfaceProjection near = [&](const Vec3d& p) { return project_to_shape(shape, p, spacing, 1); };
    const auto project_all = [&](int steps) {
        parallel_for(static_cast<uint32_t>(mesh.position.size()), 256, [&](uint32_t begin, uint32_t end) {
            for (uint32_t v = begin; v < end; ++v) mesh.position[v] = project_to_shape(shape, mesh.position[v], spacing, steps);
        });
    };
    project_all(1);
    remesh_evenly({.triangles = triangles}, near, mesh.position, mesh.triangle);
    project_all(8);
    mesh.name = shape.name;
    return mesh;
}

}  // namespace trocar
