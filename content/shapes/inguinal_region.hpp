#pragma once
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// The right inguinal region as a laparoscope in the belly sees it: shapes in metres that share one frame and fit together. The
// internal ring is at the origin; lateral is +x, ventral (up in the picture) +z, the belly is at -y. What no source is named for was
// chosen.
struct InguinalRegion {
    // The inside of the wall is y = -(x^2 / bend_x + z^2 / bend_z) / 2: hollow towards the belly.
    double bend_x = 0.25, bend_z = 0.12;                   // m, radii at the ring
    double middle_x = -0.012;                              // m, of the ellipses that bound wall and peritoneum
    double wall_x = 0.112, wall_z = 0.084;                 // m, semi-axes
    double thickness = 0.010;                              // m, of the wall, along y
    double ring = 0.015, rim = 0.004;                      // m, radius of the hole at its ends, and how much narrower it is midway
    double peritoneum_x = 0.104, peritoneum_z = 0.076;     // m, semi-axes
    double gap = 0.0035;                                   // m, between wall and peritoneum, along y
    double sac = 0.007, sac_depth = 0.034, flare = 0.005;  // m: radius, depth from the peritoneum, and rounding of the neck
    double inside(double x, double z) const { return -(x * x / bend_x + z * z / bend_z) / 2; }  // m, y of the inside of the wall
};

// Abdominal wall with the internal ring: a hole of 22 mm bore, of a hernia of medium width (1.5 to 3 cm, European Hernia Society's
// classification of groin hernias, Miserez et al. 2007). Closed, one handle. No material; triangle_material is 0 in the hole and on the
// outer edge, 1 outside, 2 inside.
Mesh make_inguinal_wall(uint32_t triangles);

// Peritoneum of the region with an indirect hernia sac, a pouch that leads through the ring: open sheet, one rim, facing the belly.
// triangle_material is 1 along the rim, 2 in the sac, 0 elsewhere.
Mesh make_peritoneum(uint32_t triangles);

// A tube of one radius with round ends, along a smooth curve through points.
struct RegionTube {
    std::vector<Vec3d> point;  // m
    double radius = 0;         // m
};

// Tubes on the inside of the wall, partly sunk into it and clear of the peritoneum: closed pieces, each with its own triangle_material.
// Vas deferens (2.6 mm across; 2 to 3 mm, Gray's Anatomy), from the ring downwards and medially, and spermatic vessels, downwards and
// laterally. In the ring they lie below the sac.
std::vector<RegionTube> cord_tubes();
Mesh make_cord(uint32_t triangles);
// Inferior epigastric vessels, medial to the ring, as one tube.
std::vector<RegionTube> epigastric_tubes();
Mesh make_epigastric_vessels(uint32_t triangles);
// External iliac artery and vein, between vas and spermatic vessels.
std::vector<RegionTube> iliac_tubes();
Mesh make_iliac_vessels(uint32_t triangles);
// Superior ramus of the pubis with Cooper's ligament on its crest: one closed piece; triangle_material 0 bone, 1 ligament.
std::vector<RegionTube> pubic_tubes();
Mesh make_pubic_bone(uint32_t triangles);

}  // namespace trocar
