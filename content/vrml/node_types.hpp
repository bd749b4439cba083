#pragma once
#include <cstdint>
#include <string_view>
namespace trocar::vrml {

// What the flattener does with a node.
enum class Role : uint8_t {
    kUnknown,
    kIgnored,         // nothing to see or touch: lights, sensors, viewpoints, scripts
    kUnsupported,     // a surface we do not build yet
    kGroup,           // children under a state of their own
    kOpenGroup,       // VRML 1.0 Group: what its children set stays set
    kTransformGroup,  // TransformSeparator: only the transform is restored
    kTransform,       // VRML 1.0 property, or VRML97 group when it has children
    kTranslation,
    kRotation,
    kRotationXYZ,
    kScale,
    kMatrix,
    kResetTransform,
    kSwitch,
    kLevels,  // LOD
    kInline,
    kShape,
    kAppearance,
    kFaceSet,           // coordIndex
    kIndexedTriangles,  // X3D; the sets that follow take their points in order where they are not indexed
    kTriangles,
    kIndexedFans,
    kFans,
    kIndexedStrips,  // X3D and Inventor
    kStrips,
    kIndexedQuads,
    kQuads,
    kPolygons,  // Inventor FaceSet
    kQuadMesh,  // Inventor
    kElevationGrid,
    kExtrusion,
    kCoordinate,
    kTextureCoordinate,
    kMaterial,
    kMaterialBinding,
    kTexture,
    kTextureTransform,
    kShapeHints,
    kColor,
    kBox,
    kSphere,
    kCone,
    kCylinder,
};

enum class Language : uint8_t { kBoth, kOne, k97 };  // whose node it is

// Surfaces over points of a coordinate node; surfaces with a shape of their own.
inline bool takes_points(Role role) { return role >= Role::kFaceSet && role <= Role::kQuadMesh; }
inline bool is_primitive(Role role) { return role >= Role::kBox && role <= Role::kCylinder; }

struct NodeType {
    std::string_view name;
    Role role = Role::kUnknown;
    Language language = Language::kBoth;
    std::string_view fields;  // names it may have, separated by blanks; "*" = not looked at
};

// The type of that name; role kUnknown when there is none.
NodeType find_node_type(std::string_view name);

// Whether a node of that type may have that field.
bool has_field(const NodeType& type, std::string_view field);

}  // namespace trocar::vrml
