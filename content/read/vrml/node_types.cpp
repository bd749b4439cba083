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
    {"Annotation", Role::kGroup, kOld, "*"},
    {"Selection", Role::kGroup, kOld, "*"},
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
    {"HAnimHumanoid", Role::kTransform, kNew, "*"},
    {"HAnimJoint", Role::kTransform, kNew, "*"},
    {"HAnimSegment", Role::kGroup, kNew, "*"},
    {"HAnimSite", Role::kTransform, kNew, "*"},
    {"HAnimDisplacer", Role::kIgnored, kNew, "*"},
    {"Humanoid", Role::kTransform, kNew, "*"},  // HAnim 1.1
    {"Joint", Role::kTransform, kNew, "*"},
    {"Segment", Role::kGroup, kNew, "*"},
    {"Site", Role::kTransform, kNew, "*"},
    {"Displacer", Role::kIgnored, kNew, "*"},
    {"CADAssembly", Role::kGroup, kNew, "*"},
    {"CADLayer", Role::kGroup, kNew, "*"},
    {"CADPart", Role::kTransform, kNew, "*"},
    {"CADFace", Role::kGroup, kNew, "*"},
    {"EspduTransform", Role::kTransform, kNew, "*"},
    {"PickableGroup", Role::kGroup, kNew, "*"},
    {"ScreenGroup", Role::kGroup, kNew, "*"},
    {"LayerSet", Role::kGroup, kNew, "*"},
    {"Layer", Role::kGroup, kNew, "*"},
    {"LayoutLayer", Role::kGroup, kNew, "*"},
    {"Viewport", Role::kGroup, kNew, "*"},
    {"ViewpointGroup", Role::kGroup, kNew, "*"},
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
    {"AsciiText", Role::kUnsupported, kOld, "*"},
    {"IndexedLineSet", Role::kIgnored, kAny, "*"},
    {"PointSet", Role::kIgnored, kAny, "*"},
    {"Text", Role::kUnsupported, kNew, "*"},
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
    {"Rectangle2D", Role::kUnsupported, kNew, "*"},
    {"Disk2D", Role::kUnsupported, kNew, "*"},
    {"TriangleSet2D", Role::kUnsupported, kNew, "*"},
    {"GeoElevationGrid", Role::kUnsupported, kNew, "*"},
    {"NurbsSurface", Role::kUnsupported, kOld, "*"},
    {"IndexedNurbsSurface", Role::kUnsupported, kOld, "*"},
    {"NurbsPatchSurface", Role::kUnsupported, kNew, "*"},
    {"NurbsTrimmedSurface", Role::kUnsupported, kNew, "*"},
    {"Text3", Role::kUnsupported, kOld, "*"},
    {"LineSet", Role::kIgnored, kAny, "*"},
    {"MovieTexture", Role::kIgnored, kNew, "*"},
    {"BaseColor", Role::kIgnored, kOld, "*"},
    {"DirectionalLight", Role::kIgnored, kAny, "*"},
    {"DirectedLight", Role::kIgnored, kOld, "*"},
    {"PointLight", Role::kIgnored, kAny, "*"},
    {"SpotLight", Role::kIgnored, kAny, "*"},
    {"OrthographicCamera", Role::kIgnored, kOld, "*"},
    {"PerspectiveCamera", Role::kIgnored, kOld, "*"},
    {"Normal", Role::kIgnored, kAny, "*"},
    {"NormalBinding", Role::kIgnored, kOld, "*"},
    {"FontStyle", Role::kIgnored, kAny, "*"},
    {"Info", Role::kIgnored, kOld, "*"},
    {"Environment", Role::kIgnored, kOld, "*"},
    {"Complexity", Role::kIgnored, kOld, "*"},
    {"DrawStyle", Role::kIgnored, kOld, "*"},
    {"LightModel", Role::kIgnored, kOld, "*"},
    {"PickStyle", Role::kIgnored, kOld, "*"},
    {"BackgroundColor", Role::kIgnored, kOld, "*"},
    {"WorldInfo", Role::kIgnored, kNew, "*"},
    {"NavigationInfo", Role::kIgnored, kNew, "*"},
    {"Viewpoint", Role::kIgnored, kNew, "*"},
    {"Background", Role::kIgnored, kNew, "*"},
    {"Fog", Role::kIgnored, kNew, "*"},
    {"Sound", Role::kIgnored, kNew, "*"},
    {"AudioClip", Role::kIgnored, kNew, "*"},
    {"Script", Role::kIgnored, kNew, "*"},
    {"TimeSensor", Role::kIgnored, kNew, "*"},
    {"TouchSensor", Role::kIgnored, kNew, "*"},
    {"PlaneSensor", Role::kIgnored, kNew, "*"},
    {"SphereSensor", Role::kIgnored, kNew, "*"},
    {"CylinderSensor", Role::kIgnored, kNew, "*"},
    {"ProximitySensor", Role::kIgnored, kNew, "*"},
    {"VisibilitySensor", Role::kIgnored, kNew, "*"},
    {"PositionInterpolator", Role::kIgnored, kNew, "*"},
    {"OrientationInterpolator", Role::kIgnored, kNew, "*"},
    {"ScalarInterpolator", Role::kIgnored, kNew, "*"},
    {"ColorInterpolator", Role::kIgnored, kNew, "*"},
    {"CoordinateInterpolator", Role::kIgnored, kNew, "*"},
    {"NormalInterpolator", Role::kIgnored, kNew, "*"},
    {"MetadataString", Role::kIgnored, kNew, "*"},
    {"MetadataSet", Role::kIgnored, kNew, "*"},
    {"MetadataFloat", Role::kIgnored, kNew, "*"},
    {"MetadataDouble", Role::kIgnored, kNew, "*"},
    {"MetadataInteger", Role::kIgnored, kNew, "*"},
    {"BooleanSequencer", Role::kIgnored, kNew, "*"},
    {"IntegerSequencer", Role::kIgnored, kNew, "*"},
    {"BooleanFilter", Role::kIgnored, kNew, "*"},
    {"BooleanToggle", Role::kIgnored, kNew, "*"},
    {"BooleanTrigger", Role::kIgnored, kNew, "*"},
    {"TimeTrigger", Role::kIgnored, kNew, "*"},
    {"KeySensor", Role::kIgnored, kNew, "*"},
    {"StringSensor", Role::kIgnored, kNew, "*"},
    {"LoadSensor", Role::kIgnored, kNew, "*"},
    {"OrthoViewpoint", Role::kIgnored, kNew, "*"},
    {"TextureBackground", Role::kIgnored, kNew, "*"},
    {"FillProperties", Role::kIgnored, kNew, "*"},
    {"LineProperties", Role::kIgnored, kNew, "*"},
}));
// clang-format on
#undef X3D_SET

}  // namespace

NodeType find_node_type(std::string_view name) {
    const auto found =
        std::lower_bound(kTypes.begin(), kTypes.end(), name, [](const NodeType& type, std::string_view n) { return type.name < n; });
    return found != kTypes.end() && found->name == name ? *found : NodeType{};
}

bool has_field(const NodeType& type, std::string_view field) {
    if (type.fields == "*" || type.role == Role::kUnknown) return true;
    // fields of every node: VRML 1.0 extensions, bounding boxes of groups, X3D
    for (const std::string_view all : {"fields", "isA", "bboxCenter", "bboxSize", "metadata", "visible", "bboxDisplay"}) {
        if (field == all) return true;
    }
    std::string_view rest = type.fields;
    while (!rest.empty()) {
        const size_t blank = rest.find(' ');
        if (rest.substr(0, blank) == field) return true;
        rest = blank == std::string_view::npos ? std::string_view{} : rest.substr(blank + 1);
    }
    return false;
}

}  // namespace trocar::vrml
