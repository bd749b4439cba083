#include "engine/draw/gl_renderer.hpp"

#include <algorithm>
#include <cmath>
#include <span>

#include "engine/base/check.hpp"
#include "engine/draw/depth_colours.hpp"
#include "engine/draw/gl_functions.hpp"
#include "engine/draw/gl_shaders.hpp"
#include "engine/draw/offscreen.hpp"
#include "engine/draw/render_mesh.hpp"
#include "engine/draw/smoke.hpp"
#include "engine/files/image_file.hpp"
#include "engine/geometry/quaternion.hpp"

namespace trocar {
namespace {

enum Attribute : GLuint { kPosition = 0, kNormal = 1, kTextureUv = 2, kDepth = 3, kLiquid = 4 };

struct Buffer {
    GLuint name = 0;
    size_t bytes = 0;
};

// Buffers shared by all bodies of one prototype.
struct StaticMesh {
    bool made = false;
    RenderMesh mesh;
    Vec3d centre = Vec3d::Zero();  // m, of the rest box; positions of rigid bodies are relative to it
    GLuint uv = 0, index = 0, rest = 0;
};

struct BodyBuffers {
    uint32_t mesh = kNone;
    bool rigid = false;
    bool grown = false;    // it has vertices that the prototype did not have at load: see upload_grown
    bool damaged = false;  // some vertex is not finite: draw the triangles in `patched` only
    GLuint array = 0;
    Buffer vertex, depth, patched, liquid;
    std::vector<RenderGroup> patched_groups;
    RenderGroup patched_lines;  // after the triangles; only with wires
};

// Options constant in a draw call; each combination is a separate program, see gl_shaders.hpp.
constexpr uint32_t kTextured = 1, kDepthColours = 2, kScope = 4, kOutline = 8, kBurnt = 16, kWet = 32, kLamp = 64, kVariants = 128;
uint32_t variant_of(bool textured, bool depth_colours, bool scope) {
    return (textured ? kTextured : 0) | (depth_colours ? kDepthColours : 0) | (scope ? kScope : 0);
}

// A linked program; its uniforms by their names in gl_shaders.hpp.
struct Program {
    GLuint name = 0;
    GLint at(const char* uniform) const { return glGetUniformLocation(name, uniform); }
};

// Program and material last set: most bodies of a crowd share both.
struct Bound {
    uint32_t variant = kVariants;
    const Material* material = nullptr;
    const Program* program = nullptr;
};

struct Target {
    uint32_t width = 0, height = 0;
    GLuint frame = 0, colour = 0, depth = 0;
    GLuint backdrop_frame = 0, backdrop_colour = 0;  // background and floor as last drawn
};

// All inputs of the backdrop besides the size of the picture.
struct BackdropKey {
    bool drawn = false, scope = false, floor = false;
    Matrix4 view_projection{};
    std::array<double, 13> camera{};  // eye, centre, axes, radius
    friend bool operator==(const BackdropKey&, const BackdropKey&) = default;
};

// Triangles of one kind and colour.
struct MarkerRun {
    Marker::Kind kind;
    std::array<float, 4> colour;
    uint32_t first, count;  // of indices
};

struct MarkerBuffers {
    GLuint array = 0;
    Buffer vertex, index;
    MarkerMesh mesh;
    std::vector<MarkerRun> runs;
};

GLuint compile(GLenum kind, uint32_t variant, const char* text) {
    const std::array<const char*, 10> parts = {shaders::kVersion,
                                              variant & kTextured ? "#define TEXTURED\n" : "",
                                              variant & kDepthColours ? "#define DEPTH_COLOURS\n" : "",
                                              variant & kScope ? "#define SCOPE\n" : "",
                                              variant & kLamp ? "#define LAMP\n" : "",
                                              variant & kOutline ? "#define OUTLINE\n" : "",
                                              variant & kBurnt ? "#define BURNT\n" : "",
                                              variant & kWet ? "#define WET\n" : "",
                                              kind == GL_FRAGMENT_SHADER ? shaders::kMask : "",
                                              text};
    const GLuint shader = glCreateShader(kind);
    glShaderSource(shader, static_cast<GLsizei>(parts.size()), parts.data(), nullptr);
    glCompileShader(shader);
    GLint compiled = 0;
    glGetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
    if (!compiled) {
        char log[1024] = "";
        glGetShaderInfoLog(shader, sizeof log, nullptr, log);
        fail_check(log, __FILE__, __LINE__);
    }
    return shader;
}

Program link(uint32_t variant, const char* vertex_text, const char* fragment_text) {
    const GLuint program = glCreateProgram();
    const GLuint vertex = compile(GL_VERTEX_SHADER, variant, vertex_text);
    const GLuint fragment = compile(GL_FRAGMENT_SHADER, variant, fragment_text);
    glAttachShader(program, vertex);
    glAttachShader(program, fragment);
    glLinkProgram(program);
    GLint linked = 0;
    glGetProgramiv(program, GL_LINK_STATUS, &linked);
    TROCAR_ASSERT(linked);
    glDeleteShader(vertex);
    glDeleteShader(fragment);
    return {program};
}

// Holds at least `bytes`; contents are lost when it grows.
void reserve(Buffer& buffer, GLenum target, size_t bytes) {
    if (!buffer.name) glGenBuffers(1, &buffer.name);
    glBindBuffer(target, buffer.name);
    if (buffer.bytes >= bytes) return;
    glBufferData(target, static_cast<GLsizeiptr>(bytes), nullptr, GL_DYNAMIC_DRAW);
    buffer.bytes = bytes;
}

// Has fill write `count` elements.
template <typename Row, typename Fill>
void stream(Buffer& buffer, size_t count, const Fill& fill) {
    reserve(buffer, GL_ARRAY_BUFFER, count * sizeof(Row));
    void* rows =
        glMapBufferRange(GL_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(count * sizeof(Row)), GL_MAP_WRITE_BIT | GL_MAP_INVALIDATE_BUFFER_BIT);
    TROCAR_ASSERT(rows);
    fill(static_cast<Row*>(rows));
    glUnmapBuffer(GL_ARRAY_BUFFER);
}

template <typename Row>
GLuint make_buffer(GLenum target, const std::vector<Row>& rows) {
    GLuint name = 0;
    glGenBuffers(1, &name);
    glBindBuffer(target, name);
    glBufferData(target, static_cast<GLsizeiptr>(rows.size() * sizeof(Row)), rows.data(), GL_STATIC_DRAW);
    return name;
}

void point_vertex_attributes() {
    glEnableVertexAttribArray(kPosition);
    glVertexAttribPointer(kPosition, 3, GL_FLOAT, GL_FALSE, sizeof(RenderVertex), nullptr);
    glEnableVertexAttribArray(kNormal);
    glVertexAttribPointer(kNormal, 3, GL_FLOAT, GL_FALSE, sizeof(RenderVertex),
                          reinterpret_cast<const void*>(offsetof(RenderVertex, normal)));
}

bool triangle_is_finite(const RenderVertex* row, const uint32_t* corner) {
    for (uint32_t k = 0; k < 3; ++k)
        for (const float x : row[corner[k]].position)
            if (!std::isfinite(x)) return false;
    return true;
}

// Vertex indices of the triangles whose corners are all finite, without removed triangles.
std::vector<uint32_t> finite_triangles(const RenderMesh& mesh, const RenderVertex* row, std::vector<RenderGroup>& groups,
                                       std::span<const Triangle> removed = {}) {
    std::vector<uint32_t> index;
    std::vector<Triangle> gone(removed.begin(), removed.end());
    std::sort(gone.begin(), gone.end());
    const auto is_gone = [&](const uint32_t* corner) {
        const Triangle t{mesh.source[corner[0]], mesh.source[corner[1]], mesh.source[corner[2]]};
        return std::binary_search(gone.begin(), gone.end(), t);
    };
    groups.clear();
    for (const RenderGroup& group : mesh.groups) {
        const uint32_t first = static_cast<uint32_t>(index.size());
        for (uint32_t i = group.first; i < group.first + group.count; i += 3)
            if (triangle_is_finite(row, &mesh.index[i]) && !is_gone(&mesh.index[i]))
                index.insert(index.end(), {mesh.index[i], mesh.index[i + 1], mesh.index[i + 2]});
        groups.push_back({group.material, first, static_cast<uint32_t>(index.size()) - first});
    }
    return index;
}

// Exposed faces have the material of the body's first triangles.
void add_exposed(const RenderMesh& mesh, const RenderVertex* row, std::span<const Triangle> exposed, std::vector<uint32_t>& index,
                 std::vector<RenderGroup>& groups) {
    if (exposed.empty() || mesh.groups.empty()) return;
    RenderGroup group{mesh.groups[0].material, static_cast<uint32_t>(index.size()), 0};
    for (const Triangle& t : exposed) {
        const Triangle rows{mesh.inside[t[0]], mesh.inside[t[1]], mesh.inside[t[2]]};
        if (triangle_is_finite(row, rows.data())) index.insert(index.end(), rows.begin(), rows.end());
    }
    group.count = static_cast<uint32_t>(index.size()) - group.first;
    groups.push_back(group);
}

// The edges of triangles whose corners are elements themselves, each once.
std::vector<uint32_t> edges_between(std::span<const uint32_t> index) {
    std::vector<std::array<uint32_t, 2>> edge;
    for (size_t i = 0; i < index.size(); ++i) {
        const uint32_t a = index[i], b = index[i - i % 3 + (i + 1) % 3];
        edge.push_back({std::min(a, b), std::max(a, b)});
    }
    std::sort(edge.begin(), edge.end());
    edge.erase(std::unique(edge.begin(), edge.end()), edge.end());
    std::vector<uint32_t> line;
    for (const auto& e : edge) line.insert(line.end(), e.begin(), e.end());
    return line;
}

// The edges of triangles, each once, also at the seams of a texture, where a vertex has several elements.
std::vector<uint32_t> edges_of(const RenderMesh& mesh, std::span<const uint32_t> index) {
    std::vector<std::array<uint32_t, 2>> edge;
    for (size_t i = 0; i < index.size(); ++i) {
        const uint32_t a = mesh.inside[mesh.source[index[i]]], b = mesh.inside[mesh.source[index[i - i % 3 + (i + 1) % 3]]];
        edge.push_back({std::min(a, b), std::max(a, b)});
    }
    std::sort(edge.begin(), edge.end());
    edge.erase(std::unique(edge.begin(), edge.end()), edge.end());
    std::vector<uint32_t> line;
    for (const auto& e : edge) line.insert(line.end(), e.begin(), e.end());
    return line;
}

bool is_see_through(const Material& material) {
    if (material.transparency > 0) return true;
    for (size_t i = 3; i < material.image.rgba.size(); i += 4)
        if (material.image.rgba[i] < 255) return true;
    return false;
}

void set_surface_defaults(GLuint palette) {
    glActiveTexture(GL_TEXTURE1);
    glBindTexture(GL_TEXTURE_2D, palette);
    glActiveTexture(GL_TEXTURE0);
    glVertexAttrib1f(kDepth, 0);
    glVertexAttrib2f(kTextureUv, 0, 0);
}

bool is_closed(const MeshInfo& info) { return info.admission == Admission::kSolid && info.volume > 0; }

Matrix4 multiply(const Matrix4& a, const Matrix4& b) {
    Matrix4 c{};
    for (uint32_t column = 0; column < 4; ++column)
        for (uint32_t row = 0; row < 4; ++row)
            for (uint32_t k = 0; k < 4; ++k) c[4 * column + row] += a[4 * k + row] * b[4 * column + k];
    return c;
}

// Columns x, y, z (axes, scaled) and the translation of a pose.
Matrix4 pose_matrix(const Vec3d& x, const Vec3d& y, const Vec3d& z, const Vec3d& t) {
    const auto f = [](double d) { return static_cast<float>(d); };
    return {f(x.x()), f(x.y()), f(x.z()), 0, f(y.x()), f(y.y()), f(y.z()), 0,
            f(z.x()), f(z.y()), f(z.z()), 0, f(t.x()), f(t.y()), f(t.z()), 1};
}

// Inverse transpose of a matrix with perpendicular columns.
std::array<float, 9> normal_matrix(const Matrix4& pose) {
    std::array<float, 9> out{};
    for (uint32_t column = 0; column < 3; ++column) {
        const float* c = &pose[4 * column];
        const float size = c[0] * c[0] + c[1] * c[1] + c[2] * c[2];
        for (uint32_t row = 0; row < 3; ++row) out[3 * column + row] = size > 0 ? c[row] / size : 0;
    }
    return out;
}

GLuint make_texture(const Image& image) {
    GLint limit = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &limit);
    Image fitted = image;
    while (std::max(fitted.width, fitted.height) > static_cast<uint32_t>(limit)) fitted = halved(fitted);
    GLuint name = 0;
    glGenTextures(1, &name);
    glBindTexture(GL_TEXTURE_2D, name);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, static_cast<GLsizei>(fitted.width), static_cast<GLsizei>(fitted.height), 0, GL_RGBA,
                 GL_UNSIGNED_BYTE, fitted.rgba.data());
    glGenerateMipmap(GL_TEXTURE_2D);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    return name;
}

// Interpolates a table linearly and clamps beyond its ends. Leaves the texture bound.
GLuint make_table_texture() {
    GLuint name = 0;
    glGenTextures(1, &name);
    glBindTexture(GL_TEXTURE_2D, name);
    for (const GLenum filter : {GL_TEXTURE_MIN_FILTER, GL_TEXTURE_MAG_FILTER}) glTexParameteri(GL_TEXTURE_2D, filter, GL_LINEAR);
    for (const GLenum wrap : {GL_TEXTURE_WRAP_S, GL_TEXTURE_WRAP_T}) glTexParameteri(GL_TEXTURE_2D, wrap, GL_CLAMP_TO_EDGE);
    return name;
}

GLuint make_palette() {
    std::vector<float> rows;
    for (uint32_t i = 0; i < 256; ++i) {
        const auto c = depth_colour(i / 255.0);
        rows.insert(rows.end(), c.begin(), c.end());
    }
    const GLuint name = make_table_texture();
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGB32F, 256, 1, 0, GL_RGB, GL_FLOAT, rows.data());
    return name;
}

}  // namespace

struct GlRenderer::Impl {
    const Meshes& meshes;
    const Material plain;  // of triangles whose material is missing
    OffscreenContext context;
    std::array<Program, kVariants> surface_programs;                            // made at first use
    std::array<Program, 2> wire_programs, background_programs, smoke_programs;  // by laparoscope
    Program floor_program, shadow_program;
    Target target;
    BackdropKey backdrop;
    MarkerBuffers marker;
    GLuint smoke_array = 0;
    Buffer smoke_vertex, smoke_index;
    std::vector<SmokeVertex> smoke;
    std::vector<uint32_t> smoke_triangles;
    GLuint empty_array = 0, palette = 0, shade_texture = 0;
    std::vector<StaticMesh> soft, rigid;                   // by prototype
    std::vector<GLuint> texture;                           // by material; 0 = not yet or none
    std::vector<uint8_t> see_through;                      // by material
    std::vector<std::pair<double, uint32_t>> far_to_near;  // transparent bodies: minus their distance, index
    std::vector<BodyBuffers> body;                         // by index of the snapshot

    explicit Impl(const Meshes& m) : meshes(m) {
        for (const Material& material : m.material) see_through.push_back(is_see_through(material));
    }

    void resize(const PictureParams& params);
    StaticMesh& static_mesh(uint32_t mesh, bool is_rigid);
    void upload(const PictureSnapshot& snapshot, const PictureParams& params);
    void make_body(BodyBuffers& buffers, uint32_t mesh, bool is_rigid);
    void upload_shape(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from, bool wires);
    void upload_patched(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from, bool wires);
    void upload_grown(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from, bool wires);
    // One number per vertex: depth of contact, or how much of the tissue coagulated.
    void upload_scalars(BodyBuffers& buffers, const std::vector<float>& all, const Range& of_body, uint32_t mesh);
    void upload_liquid(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from);
    const Program& use_surface_program(uint32_t variant, const PictureParams& params, const View& view);
    void set_pose(const Program& p, const View& view, const Matrix4& pose);
    void set_material(const Program& p, const Material& material, GLuint image);
    Matrix4 body_pose(const View& view, const PictureBody& from, uint32_t row);
    void draw_body(const PictureParams& params, const View& view, const PictureBody& from, uint32_t row, bool opaque, Bound& bound);
    void draw_backdrop(const PictureParams& params, const View& view, const Ground& ground);
    void use_ground_program(const Program& p, const View& view, const Ground& ground);
    void draw_shadows(const View& view, const Ground& ground);
    bool shows_through(uint32_t mesh) const;
    void draw_surfaces(const PictureParams& params, const View& view, const PictureSnapshot& snapshot);
    void draw_see_through(const PictureParams& params, const View& view, const PictureSnapshot& snapshot);
    void draw_wires(const PictureParams& params, const View& view, const PictureSnapshot& snapshot);
    void upload_markers(const View& view, std::span<const Marker> markers);
    void draw_markers(const PictureParams& params, const View& view, std::span<const Marker> markers);
    void draw_smoke(const PictureParams& params, const View& view, const PictureSnapshot& snapshot);
    void read_back(Image& out);
};

void GlRenderer::Impl::resize(const PictureParams& params) {
    TROCAR_ASSERT(params.width > 0 && params.height > 0);
    if (target.width == params.width && target.height == params.height) return;
    for (const GLuint frame : {target.frame, target.backdrop_frame}) glDeleteFramebuffers(1, &frame);
    for (const GLuint store : {target.colour, target.depth, target.backdrop_colour}) glDeleteRenderbuffers(1, &store);
    target = {params.width, params.height};
    backdrop = {};
    const auto attach = [&](GLuint& name, GLenum attachment, GLenum format) {
        glGenRenderbuffers(1, &name);
        glBindRenderbuffer(GL_RENDERBUFFER, name);
        glRenderbufferStorage(GL_RENDERBUFFER, format, static_cast<GLsizei>(params.width), static_cast<GLsizei>(params.height));
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, attachment, GL_RENDERBUFFER, name);
    };
    glGenFramebuffers(1, &target.frame);
    glBindFramebuffer(GL_FRAMEBUFFER, target.frame);
    attach(target.colour, GL_COLOR_ATTACHMENT0, GL_SRGB8_ALPHA8);
    attach(target.depth, GL_DEPTH_ATTACHMENT, GL_DEPTH_COMPONENT32F);
    TROCAR_ASSERT(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
    glGenFramebuffers(1, &target.backdrop_frame);
    glBindFramebuffer(GL_FRAMEBUFFER, target.backdrop_frame);
    attach(target.backdrop_colour, GL_COLOR_ATTACHMENT0, GL_SRGB8_ALPHA8);
    TROCAR_ASSERT(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
}

StaticMesh& GlRenderer::Impl::static_mesh(uint32_t mesh, bool is_rigid) {
    std::vector<StaticMesh>& all = is_rigid ? rigid : soft;
    if (all.size() <= mesh) all.resize(mesh + 1);
    StaticMesh& out = all[mesh];
    if (out.made) return out;
    out.made = true;
    const MeshView from = mesh_view(meshes, mesh);
    out.mesh = split_vertices(from, is_rigid);
    std::vector<RenderVertex> rest;
    if (is_rigid) {
        const Vec3d centre = 0.5 * (from.info->box.min + from.info->box.max);
        if (centre.allFinite()) out.centre = centre;
        for (size_t row = 0; row < out.mesh.source.size(); ++row)
            rest.push_back(make_vertex((from.position[out.mesh.source[row]] - out.centre).cast<float>(), out.mesh.normal[row]));
        std::vector<RenderGroup> groups;
        out.mesh.index = finite_triangles(out.mesh, rest.data(), groups);
        out.mesh.groups = groups;
    }
    // lines follow the triangles in the same buffer
    std::vector<uint32_t> index = out.mesh.index;
    index.insert(index.end(), out.mesh.line.begin(), out.mesh.line.end());
    glBindVertexArray(0);
    out.uv = make_buffer(GL_ARRAY_BUFFER, out.mesh.uv);
    if (is_rigid) out.rest = make_buffer(GL_ARRAY_BUFFER, rest);
    glGenBuffers(1, &out.index);
    glBindBuffer(GL_COPY_WRITE_BUFFER, out.index);
    glBufferData(GL_COPY_WRITE_BUFFER, static_cast<GLsizeiptr>(index.size() * 4), index.data(), GL_STATIC_DRAW);

    const Range materials = meshes.materials[mesh];
    if (texture.size() < meshes.material.size()) texture.resize(meshes.material.size(), 0);
    for (uint32_t m = materials.first; m < materials.end(); ++m) {
        const Image& image = meshes.material[m].image;
        const bool whole = image.width > 0 && image.height > 0 && image.rgba.size() == size_t{4} * image.width * image.height;
        if (whole && !texture[m]) texture[m] = make_texture(image);
    }
    return out;
}

void GlRenderer::Impl::make_body(BodyBuffers& buffers, uint32_t mesh, bool is_rigid) {
    const StaticMesh& shape = static_mesh(mesh, is_rigid);
    buffers.mesh = mesh;
    buffers.rigid = is_rigid;
    buffers.damaged = buffers.grown = false;
    if (!buffers.array) glGenVertexArrays(1, &buffers.array);
    glBindVertexArray(buffers.array);
    if (is_rigid) {
        glBindBuffer(GL_ARRAY_BUFFER, shape.rest);
    } else {
        reserve(buffers.vertex, GL_ARRAY_BUFFER, shape.mesh.source.size() * sizeof(RenderVertex));
    }
    point_vertex_attributes();
    glBindBuffer(GL_ARRAY_BUFFER, shape.uv);
    glEnableVertexAttribArray(kTextureUv);
    glVertexAttribPointer(kTextureUv, 2, GL_FLOAT, GL_FALSE, 0, nullptr);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, shape.index);
    glBindVertexArray(0);
}

void GlRenderer::Impl::upload_shape(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from, bool wires) {
    const RenderMesh& mesh = static_mesh(from.mesh, false).mesh;
    if (from.vertices.count > mesh.inside.size() && from.exposed.count > 0) return upload_grown(buffers, snapshot, from, wires);
    if (buffers.grown) make_body(buffers, from.mesh, false);
    const Vec3* position = snapshot.position.data() + from.vertices.first;
    const Vec3* normal = snapshot.normal.data() + from.vertices.first;
    const uint32_t* source = mesh.source.data();
    const size_t count = mesh.source.size();
    const bool was_damaged = buffers.damaged;
    stream<RenderVertex>(buffers.vertex, count, [&](RenderVertex* row) {
        float trouble = 0;  // 0 * x is not a number when x is not finite
        for (size_t i = 0; i < count; ++i) {
            const Vec3& p = position[source[i]];
            row[i] = make_vertex(p, normal[source[i]]);
            trouble += 0.0f * p.x() + 0.0f * p.y() + 0.0f * p.z();
        }
        buffers.damaged = trouble != 0 || from.removed.count > 0 || from.exposed.count > 0;
    });
    if (!buffers.damaged && !was_damaged) return;
    glBindVertexArray(buffers.array);
    if (buffers.damaged)
        upload_patched(buffers, snapshot, from, wires);
    else
        glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, static_mesh(from.mesh, false).index);
    glBindVertexArray(0);
}

void GlRenderer::Impl::upload_patched(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from, bool wires) {
    const RenderMesh& mesh = static_mesh(from.mesh, false).mesh;
    std::vector<RenderVertex> row;
    for (const uint32_t v : mesh.source)
        row.push_back(make_vertex(snapshot.position[from.vertices.first + v], snapshot.normal[from.vertices.first + v]));
    std::vector<uint32_t> index = finite_triangles(mesh, row.data(), buffers.patched_groups,
                                                   std::span(snapshot.removed).subspan(from.removed.first, from.removed.count));
    add_exposed(mesh, row.data(), std::span(snapshot.exposed).subspan(from.exposed.first, from.exposed.count), index,
                buffers.patched_groups);
    buffers.patched_lines = {0, static_cast<uint32_t>(index.size()), 0};
    if (wires) {
        const std::vector<uint32_t> line = edges_of(mesh, index);
        buffers.patched_lines.count = static_cast<uint32_t>(line.size());
        index.insert(index.end(), line.begin(), line.end());
    }
    reserve(buffers.patched, GL_ELEMENT_ARRAY_BUFFER, std::max<size_t>(index.size(), 1) * 4);
    glBufferSubData(GL_ELEMENT_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(index.size() * 4), index.data());
}

// A surface that cuts gave more vertices: all its triangles, in the material of its first ones, without texture; inside a solid in
// the last material.
void GlRenderer::Impl::upload_grown(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from, bool wires) {
    const RenderMesh& mesh = static_mesh(from.mesh, false).mesh;
    glBindVertexArray(buffers.array);
    std::vector<RenderVertex> row(from.vertices.count);
    for (uint32_t v = 0; v < from.vertices.count; ++v)
        row[v] = make_vertex(snapshot.position[from.vertices.first + v], snapshot.normal[from.vertices.first + v]);
    reserve(buffers.vertex, GL_ARRAY_BUFFER, row.size() * sizeof(RenderVertex));
    glBufferSubData(GL_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(row.size() * sizeof(RenderVertex)), row.data());
    point_vertex_attributes();
    glDisableVertexAttribArray(kTextureUv);
    std::vector<uint32_t> index;
    const auto add = [&](uint32_t first, uint32_t end) {
        for (uint32_t i = first; i < end; ++i) {
            const Triangle& t = snapshot.exposed[i];
            if (triangle_is_finite(row.data(), t.data())) index.insert(index.end(), t.begin(), t.end());
        }
        return static_cast<uint32_t>(index.size());
    };
    const uint32_t outer = add(from.exposed.first, from.exposed.end() - from.inner.count), count = add(from.inner.first, from.inner.end());
    buffers.patched_groups.assign(1, {mesh.groups.empty() ? 0 : mesh.groups[0].material, 0, outer});
    if (count > outer) buffers.patched_groups.push_back({meshes.materials[from.mesh].count - 1, outer, count - outer});
    buffers.patched_lines = {0, count, 0};
    if (wires) {
        const std::vector<uint32_t> line = edges_between(index);
        buffers.patched_lines.count = static_cast<uint32_t>(line.size());
        index.insert(index.end(), line.begin(), line.end());
    }
    reserve(buffers.patched, GL_ELEMENT_ARRAY_BUFFER, std::max<size_t>(index.size(), 1) * 4);
    glBufferSubData(GL_ELEMENT_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(index.size() * 4), index.data());
    buffers.damaged = buffers.grown = true;
    glBindVertexArray(0);
}

void GlRenderer::Impl::upload_scalars(BodyBuffers& buffers, const std::vector<float>& all, const Range& of_body, uint32_t mesh) {
    glBindVertexArray(buffers.array);
    if (of_body.count == 0 || buffers.grown) {
        glDisableVertexAttribArray(kDepth);
        return;
    }
    const std::vector<uint32_t>& source = static_mesh(mesh, buffers.rigid).mesh.source;
    const float* depth = all.data() + of_body.first;
    stream<float>(buffers.depth, source.size(), [&](float* row) {
        for (size_t i = 0; i < source.size(); ++i) row[i] = depth[source[i]];
    });
    glEnableVertexAttribArray(kDepth);
    glVertexAttribPointer(kDepth, 1, GL_FLOAT, GL_FALSE, 0, nullptr);
}

void GlRenderer::Impl::upload_liquid(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from) {
    glBindVertexArray(buffers.array);
    const std::vector<uint32_t>& source = static_mesh(from.mesh, buffers.rigid).mesh.source;
    const Float4* liquid = snapshot.liquid.data() + from.liquid.first;
    // a surface that cuts gave more vertices has them as they are
    const size_t count = buffers.grown ? from.liquid.count : source.size();
    stream<Float4>(buffers.liquid, count, [&](Float4* row) {
        for (size_t i = 0; i < count; ++i) row[i] = liquid[buffers.grown ? i : source[i]];
    });
    glEnableVertexAttribArray(kLiquid);
    glVertexAttribPointer(kLiquid, 4, GL_FLOAT, GL_FALSE, 0, nullptr);
}

void GlRenderer::Impl::upload(const PictureSnapshot& snapshot, const PictureParams& params) {
    if (body.size() < snapshot.body.size()) body.resize(snapshot.body.size());
    for (size_t row = 0; row < snapshot.body.size(); ++row) {
        const PictureBody& from = snapshot.body[row];
        if (from.mesh == kNone) continue;
        const bool is_rigid = from.vertices.count == 0;
        BodyBuffers& buffers = body[row];
        if (buffers.mesh != from.mesh || buffers.rigid != is_rigid) make_body(buffers, from.mesh, is_rigid);
        if (static_mesh(from.mesh, is_rigid).mesh.index.empty()) continue;
        if (!is_rigid) upload_shape(buffers, snapshot, from, params.wireframe);
        if (params.depth_colours)
            upload_scalars(buffers, snapshot.contact_depth, from.depths, from.mesh);
        else if (from.burnt.count > 0)
            upload_scalars(buffers, snapshot.burnt, from.burnt, from.mesh);
        if (from.liquid.count > 0 && !params.depth_colours) upload_liquid(buffers, snapshot, from);
    }
    glBindVertexArray(0);
}

Matrix4 GlRenderer::Impl::body_pose(const View& view, const PictureBody& from, uint32_t row) {
    const Quat& q = from.orientation;
    Vec3d origin = from.origin - view.eye;
    if (body[row].rigid) origin += rotate(q, static_mesh(from.mesh, true).centre);
    return pose_matrix(rotate(q, Vec3d::UnitX()), rotate(q, Vec3d::UnitY()), rotate(q, Vec3d::UnitZ()), origin);
}

void GlRenderer::Impl::set_pose(const Program& p, const View& view, const Matrix4& pose) {
    glUniformMatrix4fv(p.at("clip_from_body"), 1, GL_FALSE, multiply(view.view_projection, pose).data());
    glUniformMatrix3fv(p.at("normal_from_body"), 1, GL_FALSE, normal_matrix(pose).data());
}

void GlRenderer::Impl::set_material(const Program& p, const Material& material, GLuint image) {
    // tissue and steel are never completely dull: a minimum highlight keeps shapes readable
    const auto wet = [](float s) { return std::clamp(s, 0.06f, 1.0f); };
    glUniform3f(p.at("diffuse"), material.diffuse[0], material.diffuse[1], material.diffuse[2]);
    glUniform3f(p.at("specular"), wet(material.specular[0]), wet(material.specular[1]), wet(material.specular[2]));
    glUniform1f(p.at("shine"), 16.0f + 176.0f * std::clamp(material.shininess, 0.0f, 1.0f));
    glUniform1f(p.at("opacity"), 1.0f - std::clamp(material.transparency, 0.0f, 1.0f));
    if (image) glBindTexture(GL_TEXTURE_2D, image);
}

const Program& GlRenderer::Impl::use_surface_program(uint32_t variant, const PictureParams& params, const View& view) {
    if (view.light_at_eye && view.lamp != std::array<float, 3>{}) variant |= kLamp;
    Program& p = surface_programs[variant];
    if (!p.name) p = link(variant, shaders::kSurfaceVertex, shaders::kSurfaceFragment);
    const auto basis = [&](float x, float y, float z) {
        const Vec3 v = x * Vec3(view.right.data()) + y * Vec3(view.up.data()) + z * Vec3(view.forward.data());
        return Vec3(v.normalized());
    };
    const Vec3 key = basis(-0.45f, 0.80f, -0.65f), fill = basis(0.85f, 0.10f, -0.35f);
    glUseProgram(p.name);
    glUniform2f(p.at("size"), static_cast<float>(params.width), static_cast<float>(params.height));
    glUniform3fv(p.at("key"), 1, key.data());
    glUniform3fv(p.at("fill"), 1, fill.data());
    glUniform3fv(p.at("sky"), 1, view.sky.data());
    glUniform3fv(p.at("forward"), 1, view.forward.data());
    const Vec3 half_x = view.tan_x * Vec3(view.right.data()), half_y = view.tan_y * Vec3(view.up.data());
    const Vec3 corner = Vec3(view.forward.data()) - half_x - half_y;
    const Vec3 step_x = half_x * (2.0f / static_cast<float>(params.width));
    const Vec3 step_y = half_y * (2.0f / static_cast<float>(params.height));
    glUniform3fv(p.at("ray_corner"), 1, corner.data());
    glUniform3fv(p.at("ray_x"), 1, step_x.data());
    glUniform3fv(p.at("ray_y"), 1, step_y.data());
    glUniform1f(p.at("light_distance"), view.light_distance);
    if (variant & kLamp) glUniform3fv(p.at("lamp_at"), 1, view.lamp.data());
    glUniform1f(p.at("inv_depth_scale"), static_cast<float>(1.0 / std::max(params.depth_scale, 1e-12)));
    glUniform1i(p.at("image"), 0);
    glUniform1i(p.at("palette"), 1);
    return p;
}

void GlRenderer::Impl::use_ground_program(const Program& p, const View& view, const Ground& ground) {
    glUseProgram(p.name);
    glUniformMatrix4fv(p.at("view_projection"), 1, GL_FALSE, view.view_projection.data());
    glUniform3fv(p.at("centre"), 1, to_floats(ground.centre - view.eye).data());
    glUniform3fv(p.at("axis_x"), 1, to_floats(ground.axis_x).data());
    glUniform3fv(p.at("axis_y"), 1, to_floats(ground.axis_y).data());
    glUniform1f(p.at("radius"), static_cast<float>(ground.radius));
}

// Background and floor cost more than the organs in front of them, so they are kept until camera or floor
// change.
void GlRenderer::Impl::draw_backdrop(const PictureParams& params, const View& view, const Ground& ground) {
    BackdropKey key{true, view.light_at_eye, ground.on, view.view_projection, {}};
    for (uint32_t k = 0; k < 3 && ground.on; ++k) {
        key.camera[k] = view.eye[k];
        key.camera[3 + k] = ground.centre[k];
        key.camera[6 + k] = ground.axis_x[k];
        key.camera[9 + k] = ground.axis_y[k];
    }
    if (ground.on) key.camera[12] = ground.radius;
    if (!(key == backdrop)) {
        backdrop = key;
        glBindFramebuffer(GL_FRAMEBUFFER, target.backdrop_frame);
        glBindVertexArray(empty_array);
        Program& p = background_programs[view.light_at_eye];
        if (!p.name) p = link(variant_of(false, false, view.light_at_eye), shaders::kCoverVertex, shaders::kBackgroundFragment);
        glUseProgram(p.name);
        glUniform2f(p.at("size"), static_cast<float>(params.width), static_cast<float>(params.height));
        glDrawArrays(GL_TRIANGLES, 0, 3);
        if (ground.on) {
            const float radius = static_cast<float>(ground.radius);
            use_ground_program(floor_program, view, ground);
            glUniform4f(floor_program.at("rectangle"), 0, 0, radius, radius);
            glEnable(GL_BLEND);
            glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
            glDisable(GL_BLEND);
        }
    }
    const GLint width = static_cast<GLint>(params.width), height = static_cast<GLint>(params.height);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, target.backdrop_frame);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, target.frame);
    glBlitFramebuffer(0, 0, width, height, 0, 0, width, height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    glBindFramebuffer(GL_FRAMEBUFFER, target.frame);
}

void GlRenderer::Impl::draw_shadows(const View& view, const Ground& ground) {
    const GroundShade& shade = ground.shade;
    if (shade.columns == 0) return;
    const GLsizei columns = static_cast<GLsizei>(shade.columns), rows = static_cast<GLsizei>(shade.rows);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, shade_texture);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_R32F, columns, rows, 0, GL_RED, GL_FLOAT, shade.darkness.data());
    const Program& p = shadow_program;
    use_ground_program(p, view, ground);
    const float half_x = 0.5f * shade.cell * static_cast<float>(columns), half_y = 0.5f * shade.cell * static_cast<float>(rows);
    glUniform4f(p.at("rectangle"), shade.x + half_x, shade.y + half_y, half_x, half_y);
    glBindVertexArray(empty_array);
    glEnable(GL_BLEND);
    glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
    glDisable(GL_BLEND);
}

void GlRenderer::Impl::draw_body(const PictureParams& params, const View& view, const PictureBody& from, uint32_t row, bool opaque,
                                 Bound& bound) {
    const std::vector<RenderGroup>& groups =
        body[row].damaged ? body[row].patched_groups : static_mesh(from.mesh, body[row].rigid).mesh.groups;
    const Range materials = meshes.materials[from.mesh];
    glBindVertexArray(body[row].array);
    for (const RenderGroup& group : groups) {
        const bool known = group.material < materials.count;
        const Material& material = known ? meshes.material[materials.first + group.material] : plain;
        const GLuint image = known ? texture[materials.first + group.material] : 0;
        if (group.count == 0 || (known && see_through[materials.first + group.material]) == opaque) continue;
        const bool burnt = from.burnt.count > 0 && !params.depth_colours;
        const bool wet = from.liquid.count > 0 && !params.depth_colours;
        const uint32_t variant = variant_of(image != 0, params.depth_colours, view.light_at_eye) | (burnt ? kBurnt : 0) | (wet ? kWet : 0);
        if (bound.variant != variant) {
            bound = {variant, nullptr, &use_surface_program(variant, params, view)};
        }
        const Program& p = *bound.program;
        if (bound.material != &material) {
            bound.material = &material;
            set_material(p, material, image);
        }
        set_pose(p, view, body_pose(view, from, row));
        if (wet) glUniform3fv(p.at("up"), 1, to_floats(rotate_back(from.orientation, view.liquid_up)).data());
        glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(group.count), GL_UNSIGNED_INT,
                       reinterpret_cast<const void*>(size_t{4} * group.first));
    }
}

void GlRenderer::Impl::draw_surfaces(const PictureParams& params, const View& view, const PictureSnapshot& snapshot) {
    set_surface_defaults(palette);
    Bound bound;
    for (uint32_t row = 0; row < snapshot.body.size(); ++row) {
        const PictureBody& from = snapshot.body[row];
        if (from.mesh == kNone || row == view.hidden) continue;
        // the far side of a closed, outward body is never visible
        if (is_closed(meshes.info[from.mesh]))
            glEnable(GL_CULL_FACE);
        else
            glDisable(GL_CULL_FACE);
        draw_body(params, view, from, row, true, bound);
    }
    glDisable(GL_CULL_FACE);
}

bool GlRenderer::Impl::shows_through(uint32_t mesh) const {
    const Range materials = meshes.materials[mesh];
    for (uint32_t m = materials.first; m < materials.end(); ++m)
        if (see_through[m]) return true;
    return false;
}

// From the farthest body to the nearest, of closed ones the far side before the near one: the order of
// blending must not depend on the order of a scene and its meshes.
void GlRenderer::Impl::draw_see_through(const PictureParams& params, const View& view, const PictureSnapshot& snapshot) {
    far_to_near.clear();
    for (uint32_t row = 0; row < snapshot.body.size(); ++row) {
        const PictureBody& from = snapshot.body[row];
        if (from.mesh == kNone || row == view.hidden || !shows_through(from.mesh)) continue;
        const Vec3d middle = from.origin + rotate(from.orientation, 0.5 * (from.box.min + from.box.max));
        const double distance = (middle - view.eye).norm();
        far_to_near.emplace_back(std::isfinite(distance) ? -distance : 0.0, row);
    }
    if (far_to_near.empty()) return;
    std::sort(far_to_near.begin(), far_to_near.end());
    set_surface_defaults(palette);
    Bound bound;
    for (const auto& [distance, row] : far_to_near) {
        const PictureBody& from = snapshot.body[row];
        if (!is_closed(meshes.info[from.mesh])) {
            draw_body(params, view, from, row, false, bound);
            continue;
        }
        glEnable(GL_CULL_FACE);
        for (const GLenum hidden : {GL_FRONT, GL_BACK}) {
            glCullFace(hidden);
            draw_body(params, view, from, row, false, bound);
        }
        glDisable(GL_CULL_FACE);
    }
}

void GlRenderer::Impl::draw_wires(const PictureParams& params, const View& view, const PictureSnapshot& snapshot) {
    Program& p = wire_programs[view.light_at_eye];
    if (!p.name) p = link(variant_of(false, false, view.light_at_eye), shaders::kWireVertex, shaders::kPlainFragment);
    glUseProgram(p.name);
    glUniform2f(p.at("size"), static_cast<float>(params.width), static_cast<float>(params.height));
    glUniform1f(p.at("pull"), view.view_projection[14] * (1.0f / 0.999f - 1.0f));
    for (uint32_t row = 0; row < snapshot.body.size(); ++row) {
        const PictureBody& from = snapshot.body[row];
        if (from.mesh == kNone || row == view.hidden) continue;
        const RenderMesh& mesh = static_mesh(from.mesh, body[row].rigid).mesh;
        const RenderGroup line = body[row].damaged
                                     ? body[row].patched_lines
                                     : RenderGroup{0, static_cast<uint32_t>(mesh.index.size()), static_cast<uint32_t>(mesh.line.size())};
        if (line.count == 0) continue;
        const Matrix4 clip = multiply(view.view_projection, body_pose(view, from, row));
        glUniformMatrix4fv(p.at("clip_from_body"), 1, GL_FALSE, clip.data());
        // lines a few pixels apart would paint the body black, so they fade with their spacing
        const double distance = std::max(static_cast<double>(clip[15]), 1e-6);
        const double pixels = meshes.info[from.mesh].mean_edge * params.height / (2.0 * view.tan_y * distance);
        glUniform4f(p.at("plain"), 0.008f, 0.012f, 0.02f, 0.45f * static_cast<float>(std::clamp(pixels / 9.0, 0.12, 1.0)));
        glBindVertexArray(body[row].array);
        glDrawElements(GL_LINES, static_cast<GLsizei>(line.count), GL_UNSIGNED_INT, reinterpret_cast<const void*>(size_t{4} * line.first));
    }
}

void GlRenderer::Impl::upload_markers(const View& view, std::span<const Marker> markers) {
    MarkerMesh& mesh = marker.mesh;
    mesh.vertex.clear();
    mesh.index.clear();
    marker.runs.clear();
    for (const Marker& m : markers) {
        const uint32_t first = static_cast<uint32_t>(mesh.index.size());
        append_marker(m, view.eye, mesh);
        if (marker.runs.empty() || marker.runs.back().kind != m.kind || marker.runs.back().colour != m.colour)
            marker.runs.push_back({m.kind, m.colour, first, 0});
        marker.runs.back().count += static_cast<uint32_t>(mesh.index.size()) - first;
    }
    const auto put = [](Buffer& buffer, GLenum kind, const auto& rows) {
        reserve(buffer, kind, rows.size() * sizeof rows[0]);
        glBufferSubData(kind, 0, static_cast<GLsizeiptr>(rows.size() * sizeof rows[0]), rows.data());
    };
    if (!marker.array) glGenVertexArrays(1, &marker.array);
    glBindVertexArray(marker.array);
    put(marker.vertex, GL_ARRAY_BUFFER, mesh.vertex);
    point_vertex_attributes();
    put(marker.index, GL_ELEMENT_ARRAY_BUFFER, mesh.index);
}

void GlRenderer::Impl::draw_markers(const PictureParams& params, const View& view, std::span<const Marker> markers) {
    upload_markers(view, markers);
    const Matrix4 as_it_is = pose_matrix(Vec3d::UnitX(), Vec3d::UnitY(), Vec3d::UnitZ(), Vec3d::Zero());
    glEnable(GL_CULL_FACE);
    // faint where tissue hides them, spheres as an outline through which tissue is visible; opaque elsewhere
    for (const bool hidden : {true, false}) {
        glDepthFunc(hidden ? GL_GREATER : GL_LEQUAL);
        glDepthMask(hidden ? GL_FALSE : GL_TRUE);
        for (const MarkerRun& run : marker.runs) {
            const bool outline = hidden && run.kind == Marker::Kind::kSphere;
            const Program& p = use_surface_program(variant_of(false, false, view.light_at_eye) | (outline ? kOutline : 0), params, view);
            Material material;
            material.diffuse = {run.colour[0], run.colour[1], run.colour[2]};
            material.specular = {0.2f, 0.2f, 0.2f};
            material.shininess = 0.5f;
            material.transparency = 1.0f - run.colour[3] * (hidden && !outline ? 0.45f : 1.0f);
            set_material(p, material, 0);
            set_pose(p, view, as_it_is);
            glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(run.count), GL_UNSIGNED_INT,
                           reinterpret_cast<const void*>(size_t{4} * run.first));
        }
    }
    glDisable(GL_CULL_FACE);
    glDepthFunc(GL_LESS);
}

void GlRenderer::Impl::draw_smoke(const PictureParams& params, const View& view, const PictureSnapshot& snapshot) {
    // light that a thick cloud sends back: about that of white tissue under the same lamp
    constexpr std::array<float, 3> kGrey{0.42f, 0.43f, 0.45f};
    find_smoke(view, snapshot.puff, smoke, smoke_triangles);
    if (smoke_triangles.empty()) return;
    Program& p = smoke_programs[view.light_at_eye];
    if (!p.name) p = link(variant_of(false, false, view.light_at_eye), shaders::kSmokeVertex, shaders::kSmokeFragment);
    glUseProgram(p.name);
    glUniform2f(p.at("size"), static_cast<float>(params.width), static_cast<float>(params.height));
    glUniform3f(p.at("plain"), kGrey[0], kGrey[1], kGrey[2]);
    glUniformMatrix4fv(p.at("clip_from_body"), 1, GL_FALSE, view.view_projection.data());
    if (!smoke_array) glGenVertexArrays(1, &smoke_array);
    glBindVertexArray(smoke_array);
    reserve(smoke_vertex, GL_ARRAY_BUFFER, smoke.size() * sizeof(SmokeVertex));
    glBufferSubData(GL_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(smoke.size() * sizeof(SmokeVertex)), smoke.data());
    glEnableVertexAttribArray(kPosition);
    glVertexAttribPointer(kPosition, 3, GL_FLOAT, GL_FALSE, sizeof(SmokeVertex), nullptr);
    glEnableVertexAttribArray(kDepth);
    glVertexAttribPointer(kDepth, 1, GL_FLOAT, GL_FALSE, sizeof(SmokeVertex), reinterpret_cast<const void*>(offsetof(SmokeVertex, depth)));
    reserve(smoke_index, GL_ELEMENT_ARRAY_BUFFER, smoke_triangles.size() * 4);
    glBufferSubData(GL_ELEMENT_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(smoke_triangles.size() * 4), smoke_triangles.data());
    glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(smoke_triangles.size()), GL_UNSIGNED_INT, nullptr);
}

void GlRenderer::Impl::read_back(Image& out) {
    const GLsizei width = static_cast<GLsizei>(target.width), height = static_cast<GLsizei>(target.height);
    out.width = target.width;
    out.height = target.height;
    const size_t row = size_t{4} * target.width;
    out.rgba.resize(row * target.height);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, out.rgba.data());
    // OpenGL's first row is the lowest
    for (uint8_t *top = out.rgba.data(), *bottom = top + row * (target.height - 1); top < bottom; top += row, bottom -= row)
        std::swap_ranges(top, top + row, bottom);
}

GlRenderer::GlRenderer(const Meshes& meshes) : impl_(std::make_unique<Impl>(meshes)) {
    impl_->context.make_current();
    impl_->floor_program = link(0, shaders::kGroundVertex, shaders::kGroundFragment);
    impl_->shadow_program = link(0, shaders::kGroundVertex, shaders::kShadowFragment);
    impl_->palette = make_palette();
    impl_->shade_texture = make_table_texture();
    glGenVertexArrays(1, &impl_->empty_array);
    impl_->context.release();
}

GlRenderer::~GlRenderer() = default;

void GlRenderer::draw(const PictureParams& params, const View& view, const PictureSnapshot& snapshot, std::span<const Marker> markers,
                      const Ground& ground, Image& out) {
    Impl& gl = *impl_;
    gl.context.make_current();
    gl.resize(params);
    gl.upload(snapshot, params);
    glViewport(0, 0, static_cast<GLsizei>(params.width), static_cast<GLsizei>(params.height));
    glEnable(GL_FRAMEBUFFER_SRGB);
    glEnable(GL_DEPTH_CLAMP);  // floor and markers may extend beyond the planes that enclose the bodies
    glDisable(GL_DEPTH_TEST);
    // the picture stays opaque under all blending
    glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ZERO, GL_ONE);
    gl.draw_backdrop(params, view, ground);
    if (ground.on) gl.draw_shadows(view, ground);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_LESS);
    glDepthMask(GL_TRUE);
    glClear(GL_DEPTH_BUFFER_BIT);
    gl.draw_surfaces(params, view, snapshot);
    glEnable(GL_BLEND);
    glDepthMask(GL_FALSE);
    gl.draw_see_through(params, view, snapshot);
    if (params.wireframe) gl.draw_wires(params, view, snapshot);
    if (!params.depth_colours && !snapshot.puff.empty()) gl.draw_smoke(params, view, snapshot);
    if (!markers.empty()) gl.draw_markers(params, view, markers);
    glDisable(GL_BLEND);
    gl.read_back(out);
    glBindVertexArray(0);
    gl.context.release();
}

}  // namespace trocar
