#pragma once
#include <cstdint>
#include <string_view>
namespace trocar::vrml {

// Treatment of a node by the flattener.
enum class Role : uint8_t {
    kUnknown,
    kIgnored,         // no geometry: lights, sensors, viewpoints, scripts
    kUnsupported,     // a surface type that is not implemented
    kGroup,           // children with a state of their own
    kOpenGroup,       // VRML 1.0 Group: state set by its children persists
    kTransformGroup,  // TransformSeparator: restores only the transform
    kTransform,       // VRML 1.0 property, or VRML97 group if it has children
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
    kIndexedTriangles,  // X3D; non-indexed sets below use their points in order
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

enum class Language : uint8_t { kBoth, kOne, k97 };  // language version that the node belongs to

// takes_points: surfaces over points of a coordinate node. is_primitive: surfaces with their own shape.
inline bool takes_points(Role role) { return role >= Role::kFaceSet && role <= Role::kQuadMesh; }
inline bool is_primitive(Role role) { return role >= Role::kBox && role <= Role::kCylinder; }

struct NodeType {
    std::string_view name;
    Role role = Role::kUnknown;
    Language language = Language::kBoth;
    std::string_view fields;  // allowed names, separated by blanks; "*" = not checked
};

// The type with that name; role kUnknown if there is none.
NodeType find_node_type(std::string_view name);

// Whether a node of that type may have that field.
bool has_field(const NodeType& type, std::string_view field);

}  // namespace trocar::vrml
