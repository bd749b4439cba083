#include "content/read/vrml/node_types.hpp"

#include <algorithm>
#include <array>
namespace trocar::vrml {
namespace {

constexpr auto sort_types(auto types) {
    std::sort(types.begin(), types.end(), [](const NodeType& a, const NodeType& b) { return a.name < b.name; });
    return types;
}

constexpr Language kAny = Language::kBoth, kOld = Language::kOne, kNew = Language::k97;

// fields of every triangle and quadrilateral set in X3D
#define X3D_SET "coord texCoord normal color ccw solid colorPerVertex normalPerVertex attrib fogCoord"

// clang-format off
constexpr auto kTypes = sort_types(std::to_array<NodeType>({
    {"Separator", Role::kGroup, kOld, "renderCulling renderCaching boundingBoxCaching pickCulling"},
    {"WWWAnchor", Role::kGroup, kOld, "name description map"},
    {"Group", Role::kOpenGroup, kAny, "children"},
    {"TransformSeparator", Role::kTransformGroup, kOld, ""},
    {"Anchor", Role::kGroup, kNew, "children url description parameter"},
    {"Billboard", Role::kGroup, kNew, "children axisOfRotation"},
    {"Collision", Role::kGroup, kNew, "children collide enabled proxy"},
    {"StaticGroup", Role::kGroup, kNew, "children"},
    {"Transform", Role::kTransform, kAny, "children translation rotation scaleFactor scale scaleOrientation center"},
    {"Translation", Role::kTranslation, kOld, "translation"},
    {"Rotation", Role::kRotation, kOld, "rotation"},
    {"RotationXYZ", Role::kRotationXYZ, kOld, "axis angle"},
    {"ResetTransform", Role::kResetTransform, kOld, "whatToReset"},
    {"Scale", Role::kScale, kOld, "scaleFactor"},
    {"MatrixTransform", Role::kMatrix, kAny, "matrix children render"},
    {"Switch", Role::kSwitch, kAny, "whichChild whichChoice choice children"},
    {"LOD", Role::kLevels, kAny, "range center level children forceTransitions"},
    {"WWWInline", Role::kInline, kOld, "name bboxSize bboxCenter"},
    {"File", Role::kInline, kOld, "name"},
    {"Inline", Role::kInline, kNew, "url load"},
    {"InlineLoadControl", Role::kInline, kNew, "url load"},
    {"Shape", Role::kShape, kNew, "appearance geometry"},
    {"Appearance", Role::kAppearance, kNew, "material texture textureTransform lineProperties fillProperties pointProperties shaders backMaterial alphaMode "
     "alphaCutoff"},
    {"IndexedFaceSet", Role::kFaceSet, kAny,
     "coordIndex materialIndex normalIndex textureCoordIndex texCoordIndex vertexProperty attrib fogCoord coord texCoord normal normalPerVertex color "
     "colorIndex colorPerVertex ccw solid convex creaseAngle"},
    {"Coordinate3", Role::kCoordinate, kOld, "point"},
    {"Coordinate", Role::kCoordinate, kNew, "point"},
    {"CoordinateDouble", Role::kCoordinate, kNew, "point"},
    {"TextureCoordinate2", Role::kTextureCoordinate, kOld, "point"},
    {"TextureCoordinate", Role::kTextureCoordinate, kNew, "point"},
    {"Material", Role::kMaterial, kAny,
     "ambientColor diffuseColor specularColor emissiveColor shininess transparency ambientIntensity"},
    {"MaterialBinding", Role::kMaterialBinding, kOld, "value"},
    {"Texture2", Role::kTexture, kOld, "filename image wrapS wrapT model blendColor"},
    {"ImageTexture", Role::kTexture, kNew, "url repeatS repeatT"},
    {"PixelTexture", Role::kTexture, kNew, "image repeatS repeatT"},
    {"Texture2Transform", Role::kTextureTransform, kOld, "translation rotation scaleFactor center"},
    {"TextureTransform", Role::kTextureTransform, kNew, "translation rotation scale center"},
    {"ShapeHints", Role::kShapeHints, kOld, "vertexOrdering shapeType faceType creaseAngle"},
    {"Color", Role::kColor, kNew, "color"},
    {"Cube", Role::kBox, kOld, "width height depth"},
    {"Box", Role::kBox, kNew, "size solid"},
    {"Sphere", Role::kSphere, kAny, "radius solid"},
    {"Cone", Role::kCone, kAny, "parts bottomRadius height bottom side solid"},
    {"Cylinder", Role::kCylinder, kAny, "parts radius height bottom side top solid"},
    {"Extrusion", Role::kExtrusion, kNew,
     "crossSection spine scale orientation beginCap endCap ccw solid convex creaseAngle"},
    {"ElevationGrid", Role::kElevationGrid, kNew,
     "xDimension zDimension xSpacing zSpacing height color texCoord normal colorPerVertex normalPerVertex ccw solid "
     "creaseAngle attrib fogCoord"},
    {"IndexedTriangleSet", Role::kIndexedTriangles, kNew, "index " X3D_SET},
    {"TriangleSet", Role::kTriangles, kNew, X3D_SET},
    {"IndexedTriangleFanSet", Role::kIndexedFans, kNew, "index " X3D_SET},
    {"TriangleFanSet", Role::kFans, kNew, "fanCount " X3D_SET},
    {"IndexedTriangleStripSet", Role::kIndexedStrips, kAny,
     "index coordIndex materialIndex normalIndex textureCoordIndex vertexProperty " X3D_SET},
    {"TriangleStripSet", Role::kStrips, kAny, "stripCount numVertices startIndex vertexProperty " X3D_SET},
    {"IndexedQuadSet", Role::kIndexedQuads, kNew, "index " X3D_SET},
    {"QuadSet", Role::kQuads, kNew, X3D_SET},
    {"FaceSet", Role::kPolygons, kOld, "numVertices startIndex vertexProperty"},
    {"QuadMesh", Role::kQuadMesh, kOld, "verticesPerRow verticesPerColumn startIndex vertexProperty"},
}));

// Nodes of which any field is accepted: names separated by blanks.
struct NodeList {
    Role role;
    Language language;
    std::string_view names;
};
constexpr NodeList kLists[] = {
    {Role::kGroup, kOld,
     "Annotation Selection"},
    {Role::kGroup, kNew,
     "HAnimSegment Segment CADAssembly CADLayer CADFace PickableGroup ScreenGroup LayerSet Layer LayoutLayer "
     "Viewport ViewpointGroup"},
    {Role::kTransform, kNew,
     "HAnimHumanoid HAnimJoint HAnimSite Humanoid Joint Site CADPart EspduTransform"},
    {Role::kUnsupported, kOld,
     "AsciiText NurbsSurface IndexedNurbsSurface Text3"},
    {Role::kUnsupported, kNew,
     "Text Rectangle2D Disk2D TriangleSet2D GeoElevationGrid NurbsPatchSurface NurbsTrimmedSurface"},
    {Role::kIgnored, kOld,
     "BaseColor DirectedLight OrthographicCamera PerspectiveCamera NormalBinding Info Environment Complexity "
     "DrawStyle LightModel PickStyle BackgroundColor"},
    {Role::kIgnored, kNew,
     "HAnimDisplacer Displacer MovieTexture WorldInfo NavigationInfo Viewpoint Background Fog Sound AudioClip Script "
     "TimeSensor TouchSensor PlaneSensor SphereSensor CylinderSensor ProximitySensor VisibilitySensor "
     "PositionInterpolator OrientationInterpolator ScalarInterpolator ColorInterpolator CoordinateInterpolator "
     "NormalInterpolator MetadataString MetadataSet MetadataFloat MetadataDouble MetadataInteger BooleanSequencer "
     "IntegerSequencer BooleanFilter BooleanToggle BooleanTrigger TimeTrigger KeySensor StringSensor LoadSensor "
     "OrthoViewpoint TextureBackground FillProperties LineProperties"},
    {Role::kIgnored, kAny,
     "IndexedLineSet PointSet LineSet DirectionalLight PointLight SpotLight Normal FontStyle"},
};
// clang-format on
#undef X3D_SET

// Where a word stands in a list of words separated by blanks.
size_t find_word(std::string_view list, std::string_view word) {
    for (size_t at = list.find(word); at != std::string_view::npos; at = list.find(word, at + 1)) {
        const size_t end = at + word.size();
        if ((at == 0 || list[at - 1] == ' ') && (end == list.size() || list[end] == ' ')) return at;
    }
    return std::string_view::npos;
}

}  // namespace

NodeType find_node_type(std::string_view name) {
    const auto found =
        std::lower_bound(kTypes.begin(), kTypes.end(), name, [](const NodeType& type, std::string_view n) { return type.name < n; });
    if (found != kTypes.end() && found->name == name) return *found;
    for (const NodeList& list : kLists) {
        const size_t at = name.empty() ? std::string_view::npos : find_word(list.names, name);
        if (at != std::string_view::npos) return {list.names.substr(at, name.size()), list.role, list.language, "*"};
    }
    return {};
}

bool has_field(const NodeType& type, std::string_view field) {
    if (type.fields == "*" || type.role == Role::kUnknown) return true;
    // fields of every node: VRML 1.0 extensions, bounding boxes of groups, X3D
    for (const std::string_view names : {std::string_view("fields isA bboxCenter bboxSize metadata visible bboxDisplay"), type.fields}) {
        if (!field.empty() && find_word(names, field) != std::string_view::npos) return true;
    }
    return false;
}

}  // namespace trocar::vrml
