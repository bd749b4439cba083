#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// Result that a reader in a child process returns. Images stay encoded: the parent decodes them.
struct MeshStream {
    Mesh mesh;
    std::vector<std::string> picture;  // per material: PNG, JPEG or GIF bytes embedded in the file, or empty
    std::vector<std::string> warnings;
    std::string format;
};

// Binary encoding: "trocar mesh 1\n", the counts as 64-bit numbers (vertices, triangles, texture coordinates,
// triangle_material entries, materials, warnings), then positions (3 doubles), triangles (3 x 32 bits),
// texture coordinates (6 floats), material indices (16 bits), materials (name, texture, picture, 8 floats),
// format, warnings. Little endian, unpadded; a text is its 64-bit length followed by its bytes.
std::string encode_mesh_stream(const MeshStream& stream);

// Validates everything: counts against the available bytes, corners and materials against the counts, every
// number finite, no trailing bytes. Throws InputError with the reason, without a file name.
MeshStream decode_mesh_stream(std::string_view bytes);

}  // namespace trocar
