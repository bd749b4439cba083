#pragma once
#include <array>
#include <string>
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

using Triangle = std::array<uint32_t, 3>;  // corners, counter-clockwise seen from outside

// Eight-bit RGBA picture, rows top to bottom, width * height * 4 bytes.
struct Image {
    uint32_t width = 0;
    uint32_t height = 0;
    std::vector<uint8_t> rgba;
    TROCAR_FIELDS(width, height, rgba);
};

// Appearance of a surface. Colours are linear, 0..1.
struct Material {
    std::string name;
    std::array<float, 3> diffuse{0.8f, 0.8f, 0.8f};
    std::array<float, 3> specular{0.0f, 0.0f, 0.0f};
    float shininess = 0.2f;     // VRML scale, 0..1
    float transparency = 0.0f;  // 0 opaque
    std::string texture;        // name or path given by the file, empty if none
    Image image;                // pixels of the texture, empty until loaded
    TROCAR_FIELDS(name, diffuse, specular, shininess, transparency, texture, image);
};

// One surface as read or generated: indexed triangles in file units, in double precision.
struct Mesh {
    std::string name;
    std::vector<Vec3d> position;
    std::vector<Triangle> triangle;
    std::vector<std::array<Vec2, 3>> uv;      // per triangle corner; empty, or one element per triangle
    std::vector<uint16_t> triangle_material;  // empty = material 0 for all
    std::vector<Material> material;           // may be empty
};

// How a surface may take part in contact, decided once at load.
enum class Admission : uint8_t {
    kSolid,    // closed, manifold, oriented, no self-crossing: sign by angle-weighted pseudonormal
    kWinding,  // closed but not solid: sign by generalised winding number
    kSheet,    // open: a thickness, no inside
    kRefused,  // nothing to collide with (no face, non-finite coordinate)
};

// Every prototype mesh of a scene, flat. A prototype owns ranges; the indices inside a range are local to the
// prototype, so that copies of a body share one topology. Constant after load. Metres, body frame.
struct MeshInfo {
    Range vertices;           // range of position, incident_first (see below)
    Range triangles;          // range of triangle, neighbour, triangle_edge
    Range edges;              // range of edge
    Range incident;           // range of incident
    uint32_t components = 0;  // edge-connected pieces
    Admission admission = Admission::kRefused;
    double volume = 0;     // m^3, signed volume of the closed surface
    double area = 0;       // m^2
    double mean_edge = 0;  // m
    double max_edge = 0;   // m
    double radius = 0;     // m, largest distance of a vertex from the origin of the body frame
    Box box;               // of the rest shape, body frame
    TROCAR_FIELDS(vertices, triangles, edges, incident, components, admission, volume, "m^3", area, "m^2", mean_edge, "m", max_edge, "m",
                  radius, "m", box, "m");
};

struct Meshes {
    std::vector<std::string> name;                       // one per prototype
    std::vector<MeshInfo> info;                          // one per prototype
    std::vector<Vec3d> position;                         // rest position of a vertex
    std::vector<uint32_t> component;                     // piece a vertex belongs to
    std::vector<Triangle> triangle;                      // local vertices
    std::vector<std::array<uint32_t, 3>> neighbour;      // local triangle across corner edge k -> k+1, or kNone
    std::vector<std::array<uint32_t, 3>> triangle_edge;  // local edge of corner edge k -> k+1
    std::vector<std::array<uint32_t, 2>> edge;           // local vertices, lower first, ascending
    std::vector<std::array<uint32_t, 2>> edge_triangle;  // local triangles on both sides, kNone at a rim
    std::vector<uint32_t> incident_first;                // vertices.count + 1 elements per prototype, at vertices.first + prototype index
    std::vector<uint32_t> incident;                      // local triangles around a vertex, ascending
    std::vector<std::array<Vec2, 3>> uv;                 // as triangle; zero where the file has none
    std::vector<uint16_t> triangle_material;             // as triangle; index into `material` of the prototype
    std::vector<Range> materials;                        // one per prototype: range of material
    std::vector<Material> material;
    TROCAR_FIELDS(name, info, position, "m", component, triangle, neighbour, triangle_edge, edge, edge_triangle, incident_first, incident,
                  uv, triangle_material, materials, material);
};

}  // namespace trocar
