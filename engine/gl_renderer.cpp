#include "engine/gl_renderer.hpp"

#define GL_GLEXT_PROTOTYPES
#include <GL/osmesa.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "engine/check.hpp"
#include "engine/depth_colours.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/gl_shaders.hpp"
#include "engine/offscreen.hpp"
#include "engine/render_mesh.hpp"

namespace trocar {
namespace {

enum Attribute : GLuint { kPosition = 0, kNormal = 1, kTextureUv = 2, kDepth = 3 };

// Position and normal of a row, as they go up.
struct Vertex {
    float position[3];
    float normal[3];
};

struct Buffer {
    GLuint name = 0;
    size_t bytes = 0;
};

// What all bodies of one prototype share.
struct StaticMesh {
    bool made = false;
    RenderMesh mesh;
    Vec3d centre = Vec3d::Zero();  // m, of the rest box; positions of rigid bodies are relative to it
    GLuint uv = 0, index = 0, rest = 0;
};

struct BodyBuffers {
    uint32_t mesh = kNone;
    bool rigid = false;
    bool damaged = false;  // some vertex is not finite: draw the triangles in `patched` only
    GLuint array = 0;
    Buffer vertex, depth, patched;
    std::vector<RenderGroup> patched_groups;
};

struct SurfaceProgram {
    GLuint name = 0;
    GLint clip_from_body, eye_from_body, normal_from_body;
    GLint diffuse, specular, shine, opacity, textured, depth_colours, light_at_eye, inv_depth_scale, light_distance;
    GLint key, fill, sky, forward, image, palette;
};

struct Programs {
    SurfaceProgram surface;
    GLuint wire = 0, background = 0, ground = 0, mask = 0;
    GLint wire_clip, wire_plain, wire_pull, background_size, background_scope, mask_size;
    GLint ground_view, ground_centre, ground_x, ground_y, ground_radius, ground_shadows, ground_shape, ground_rest;
};

struct Target {
    uint32_t width = 0, height = 0, samples = 0;
    GLuint drawn = 0, drawn_colour = 0, drawn_depth = 0;  // where we draw
    GLuint resolved = 0, resolved_colour = 0;             // one sample a pixel; unused without multisampling
};

struct MarkerMesh {
    GLuint array = 0, vertex = 0, index = 0;
    GLsizei sphere_count = 0, shaft_count = 0, head_count = 0;
};

GLuint compile(GLenum kind, const char* text) {
    const GLuint shader = glCreateShader(kind);
    glShaderSource(shader, 1, &text, nullptr);
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

GLuint link(const char* vertex_text, const char* fragment_text) {
    const GLuint program = glCreateProgram();
    const GLuint vertex = compile(GL_VERTEX_SHADER, vertex_text);
    const GLuint fragment = compile(GL_FRAGMENT_SHADER, fragment_text);
    glAttachShader(program, vertex);
    glAttachShader(program, fragment);
    glLinkProgram(program);
    GLint linked = 0;
    glGetProgramiv(program, GL_LINK_STATUS, &linked);
    TROCAR_ASSERT(linked);
    glDeleteShader(vertex);
    glDeleteShader(fragment);
    return program;
}

SurfaceProgram make_surface_program() {
    SurfaceProgram p;
    p.name = link(shaders::kSurfaceVertex, shaders::kSurfaceFragment);
    const auto at = [&p](const char* name) { return glGetUniformLocation(p.name, name); };
    p.clip_from_body = at("clip_from_body");
    p.eye_from_body = at("eye_from_body");
    p.normal_from_body = at("normal_from_body");
    p.diffuse = at("diffuse");
    p.specular = at("specular");
    p.shine = at("shine");
    p.opacity = at("opacity");
    p.textured = at("textured");
    p.depth_colours = at("depth_colours");
    p.light_at_eye = at("light_at_eye");
    p.inv_depth_scale = at("inv_depth_scale");
    p.light_distance = at("light_distance");
    p.key = at("key");
    p.fill = at("fill");
    p.sky = at("sky");
    p.forward = at("forward");
    p.image = at("image");
    p.palette = at("palette");
    return p;
}

Programs make_programs() {
    Programs p;
    p.surface = make_surface_program();
    p.wire = link(shaders::kWireVertex, shaders::kPlainFragment);
    p.wire_clip = glGetUniformLocation(p.wire, "clip_from_body");
    p.wire_pull = glGetUniformLocation(p.wire, "pull");
    p.wire_plain = glGetUniformLocation(p.wire, "plain");
    p.background = link(shaders::kCoverVertex, shaders::kBackgroundFragment);
    p.background_size = glGetUniformLocation(p.background, "size");
    p.background_scope = glGetUniformLocation(p.background, "light_at_eye");
    p.mask = link(shaders::kCoverVertex, shaders::kMaskFragment);
    p.mask_size = glGetUniformLocation(p.mask, "size");
    p.ground = link(shaders::kGroundVertex, shaders::kGroundFragment);
    p.ground_view = glGetUniformLocation(p.ground, "view_projection");
    p.ground_centre = glGetUniformLocation(p.ground, "centre");
    p.ground_x = glGetUniformLocation(p.ground, "axis_x");
    p.ground_y = glGetUniformLocation(p.ground, "axis_y");
    p.ground_radius = glGetUniformLocation(p.ground, "radius");
    p.ground_shadows = glGetUniformLocation(p.ground, "shadows");
    p.ground_shape = glGetUniformLocation(p.ground, "shadow_shape");
    p.ground_rest = glGetUniformLocation(p.ground, "shadow_rest");
    return p;
}

// Holds at least `bytes`; contents are lost when it grows.
void reserve(Buffer& buffer, GLenum target, size_t bytes) {
    if (!buffer.name) glGenBuffers(1, &buffer.name);
    glBindBuffer(target, buffer.name);
    if (buffer.bytes >= bytes) return;
    glBufferData(target, static_cast<GLsizeiptr>(bytes), nullptr, GL_DYNAMIC_DRAW);
    buffer.bytes = bytes;
}

// Writes `count` rows by fill(rows).
template <typename Row, typename Fill>
void stream(Buffer& buffer, size_t count, const Fill& fill) {
    reserve(buffer, GL_ARRAY_BUFFER, count * sizeof(Row));
    void* rows = glMapBufferRange(GL_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(count * sizeof(Row)),
                                  GL_MAP_WRITE_BIT | GL_MAP_INVALIDATE_BUFFER_BIT);
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
    glVertexAttribPointer(kPosition, 3, GL_FLOAT, GL_FALSE, sizeof(Vertex), nullptr);
    glEnableVertexAttribArray(kNormal);
    glVertexAttribPointer(kNormal, 3, GL_FLOAT, GL_FALSE, sizeof(Vertex),
                          reinterpret_cast<const void*>(offsetof(Vertex, normal)));
}

Vertex make_vertex(const Vec3& p, const Vec3& n) { return {{p.x(), p.y(), p.z()}, {n.x(), n.y(), n.z()}}; }

bool triangle_is_finite(const Vertex* row, const uint32_t* corner) {
    for (uint32_t k = 0; k < 3; ++k)
        for (const float x : row[corner[k]].position)
            if (!std::isfinite(x)) return false;
    return true;
}

// The index rows of the triangles whose corners are all finite.
std::vector<uint32_t> finite_triangles(const RenderMesh& mesh, const Vertex* row, std::vector<RenderGroup>& groups) {
    std::vector<uint32_t> index;
    groups.clear();
    for (const RenderGroup& group : mesh.groups) {
        const uint32_t first = static_cast<uint32_t>(index.size());
        for (uint32_t i = group.first; i < group.first + group.count; i += 3)
            if (triangle_is_finite(row, &mesh.index[i]))
                index.insert(index.end(), {mesh.index[i], mesh.index[i + 1], mesh.index[i + 2]});
        groups.push_back({group.material, first, static_cast<uint32_t>(index.size()) - first});
    }
    return index;
}

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

std::array<float, 3> floats(const Vec3d& v) {
    return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

// Halves an image that is larger than `limit` until it fits (box filter on encoded values: a fallback, not a look).
Image fit_image(const Image& image, uint32_t limit) {
    Image out = image;
    while (out.width > limit || out.height > limit) {
        Image half{std::max(1u, out.width / 2), std::max(1u, out.height / 2), {}};
        half.rgba.resize(size_t{4} * half.width * half.height);
        for (uint32_t y = 0; y < half.height; ++y)
            for (uint32_t x = 0; x < half.width; ++x)
                for (uint32_t c = 0; c < 4; ++c) {
                    const auto at = [&](uint32_t dx, uint32_t dy) {
                        const size_t px = std::min(2 * x + dx, out.width - 1),
                                     py = std::min(2 * y + dy, out.height - 1);
                        return uint32_t{out.rgba[4 * (py * out.width + px) + c]};
                    };
                    half.rgba[4 * (size_t{y} * half.width + x) + c] =
                        static_cast<uint8_t>((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1) + 2) / 4);
                }
        out = std::move(half);
    }
    return out;
}

GLuint make_texture(const Image& image) {
    GLint limit = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &limit);
    const Image fitted = fit_image(image, static_cast<uint32_t>(limit));
    GLuint name = 0;
    glGenTextures(1, &name);
    glBindTexture(GL_TEXTURE_2D, name);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_SRGB8_ALPHA8, static_cast<GLsizei>(fitted.width),
                 static_cast<GLsizei>(fitted.height), 0, GL_RGBA, GL_UNSIGNED_BYTE, fitted.rgba.data());
    glGenerateMipmap(GL_TEXTURE_2D);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    return name;
}

GLuint make_palette() {
    std::vector<float> rows;
    for (uint32_t i = 0; i < 256; ++i) {
        const auto c = depth_colour(i / 255.0);
        rows.insert(rows.end(), c.begin(), c.end());
    }
    GLuint name = 0;
    glGenTextures(1, &name);
    glBindTexture(GL_TEXTURE_2D, name);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGB32F, 256, 1, 0, GL_RGB, GL_FLOAT, rows.data());
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    return name;
}

// Rings of a surface of revolution about z: radius, height and normal (radial, axial) of each ring.
struct Ring {
    float radius, height, radial, axial;
};
void add_rings(const std::vector<Ring>& rings, std::vector<Vertex>& vertex, std::vector<uint32_t>& index) {
    constexpr uint32_t kSides = 24;
    const uint32_t first = static_cast<uint32_t>(vertex.size());
    for (const Ring& ring : rings)
        for (uint32_t i = 0; i < kSides; ++i) {
            const float angle = 2 * std::numbers::pi_v<float> * static_cast<float>(i) / kSides;
            const float c = std::cos(angle), s = std::sin(angle);
            vertex.push_back(
                {{ring.radius * c, ring.radius * s, ring.height}, {ring.radial * c, ring.radial * s, ring.axial}});
        }
    for (uint32_t r = 0; r + 1 < rings.size(); ++r)
        for (uint32_t i = 0; i < kSides; ++i) {
            const uint32_t a = first + r * kSides + i, b = first + r * kSides + (i + 1) % kSides;
            index.insert(index.end(), {a, b, b + kSides, a, b + kSides, a + kSides});
        }
}

// Unit sphere, unit shaft (radius 1, z 0..1) and unit head (base radius 1 at z 0, tip at z 1) in one pair of buffers.
MarkerMesh make_marker_mesh() {
    std::vector<Vertex> vertex;
    std::vector<uint32_t> index;
    std::vector<Ring> sphere;
    for (uint32_t i = 0; i <= 16; ++i) {
        const float angle = std::numbers::pi_v<float> * (static_cast<float>(i) / 16 - 0.5f);
        sphere.push_back({std::cos(angle), std::sin(angle), std::cos(angle), std::sin(angle)});
    }
    MarkerMesh out;
    add_rings(sphere, vertex, index);
    out.sphere_count = static_cast<GLsizei>(index.size());
    add_rings({{0, 0, 0, -1}, {1, 0, 0, -1}, {1, 0, 1, 0}, {1, 1, 1, 0}}, vertex, index);
    out.shaft_count = static_cast<GLsizei>(index.size()) - out.sphere_count;
    add_rings({{0, 0, 0, -1}, {1, 0, 0, -1}, {1, 0, 0.8f, 0.6f}, {0, 1, 0.8f, 0.6f}}, vertex, index);
    out.head_count = static_cast<GLsizei>(index.size()) - out.sphere_count - out.shaft_count;
    glGenVertexArrays(1, &out.array);
    glBindVertexArray(out.array);
    out.vertex = make_buffer(GL_ARRAY_BUFFER, vertex);
    point_vertex_attributes();
    out.index = make_buffer(GL_ELEMENT_ARRAY_BUFFER, index);
    glBindVertexArray(0);
    return out;
}

// Axes of a marker standing along z.
void perpendicular_axes(const Vec3d& z, Vec3d& x, Vec3d& y) {
    const Vec3d helper = std::abs(z.x()) < 0.7 ? Vec3d(Vec3d::UnitX()) : Vec3d(Vec3d::UnitY());
    x = z.cross(helper).normalized();
    y = z.cross(x);
}

}  // namespace

struct GlRenderer::Impl {
    const Meshes& meshes;
    const Material plain;  // of triangles whose material is not there
    OffscreenContext context;
    Programs programs;
    Target target;
    MarkerMesh marker;
    GLuint empty_array = 0, palette = 0;
    std::vector<StaticMesh> soft, rigid;  // by prototype
    std::vector<GLuint> texture;          // by material; 0 = not yet or none
    std::vector<BodyBuffers> body;        // by row of the snapshot
    std::vector<uint8_t> row_copy;        // one row of pixels

    explicit Impl(const Meshes& m) : meshes(m) {}

    void resize(const PictureParams& params);
    void free_target();
    StaticMesh& static_mesh(uint32_t mesh, bool is_rigid);
    void upload(const PictureSnapshot& snapshot, const PictureParams& params);
    void make_body(BodyBuffers& buffers, uint32_t mesh, bool is_rigid);
    void upload_shape(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from);
    void upload_depths(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from);
    void set_pose(const View& view, const Matrix4& pose);
    void set_material(const Material& material, GLuint image);
    Matrix4 body_pose(const View& view, const PictureBody& from, uint32_t row);
    void begin_surfaces(const PictureParams& params, const View& view);
    void draw_background(const PictureParams& params, const View& view, const Ground& ground);
    void draw_surfaces(const PictureParams& params, const View& view, const PictureSnapshot& snapshot, bool opaque);
    void draw_wires(const View& view, const PictureSnapshot& snapshot);
    void draw_markers(const PictureParams& params, const View& view, std::span<const Marker> markers);
    void draw_marker(const View& view, const Marker& marker_row);
    void read_back(Image& out);
};

void GlRenderer::Impl::free_target() {
    glDeleteFramebuffers(1, &target.drawn);
    glDeleteFramebuffers(1, &target.resolved);
    glDeleteRenderbuffers(1, &target.drawn_colour);
    glDeleteRenderbuffers(1, &target.drawn_depth);
    glDeleteRenderbuffers(1, &target.resolved_colour);
    target = {};
}

void GlRenderer::Impl::resize(const PictureParams& params) {
    TROCAR_ASSERT(params.width > 0 && params.height > 0);
    if (target.width == params.width && target.height == params.height && target.samples == params.samples) return;
    free_target();
    target.width = params.width;
    target.height = params.height;
    target.samples = params.samples;
    const GLsizei width = static_cast<GLsizei>(params.width), height = static_cast<GLsizei>(params.height);
    const GLsizei samples = params.samples > 1 ? 4 : 0;
    const auto storage = [&](GLuint& name, GLenum format, GLsizei count) {
        glGenRenderbuffers(1, &name);
        glBindRenderbuffer(GL_RENDERBUFFER, name);
        glRenderbufferStorageMultisample(GL_RENDERBUFFER, count, format, width, height);
    };
    storage(target.drawn_colour, GL_SRGB8_ALPHA8, samples);
    storage(target.drawn_depth, GL_DEPTH_COMPONENT32F, samples);
    glGenFramebuffers(1, &target.drawn);
    glBindFramebuffer(GL_FRAMEBUFFER, target.drawn);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, target.drawn_colour);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, target.drawn_depth);
    TROCAR_ASSERT(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
    if (samples == 0) return;
    storage(target.resolved_colour, GL_SRGB8_ALPHA8, 0);
    glGenFramebuffers(1, &target.resolved);
    glBindFramebuffer(GL_FRAMEBUFFER, target.resolved);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, target.resolved_colour);
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
    std::vector<Vertex> rest;
    if (is_rigid) {
        const Vec3d centre = 0.5 * (from.info->box.min + from.info->box.max);
        if (centre.allFinite()) out.centre = centre;
        for (size_t row = 0; row < out.mesh.source.size(); ++row)
            rest.push_back(
                make_vertex((from.position[out.mesh.source[row]] - out.centre).cast<float>(), out.mesh.normal[row]));
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
        const bool whole =
            image.width > 0 && image.height > 0 && image.rgba.size() == size_t{4} * image.width * image.height;
        if (whole && !texture[m]) texture[m] = make_texture(image);
    }
    return out;
}

void GlRenderer::Impl::make_body(BodyBuffers& buffers, uint32_t mesh, bool is_rigid) {
    const StaticMesh& shape = static_mesh(mesh, is_rigid);
    buffers.mesh = mesh;
    buffers.rigid = is_rigid;
    buffers.damaged = false;
    if (!buffers.array) glGenVertexArrays(1, &buffers.array);
    glBindVertexArray(buffers.array);
    if (is_rigid) {
        glBindBuffer(GL_ARRAY_BUFFER, shape.rest);
    } else {
        reserve(buffers.vertex, GL_ARRAY_BUFFER, shape.mesh.source.size() * sizeof(Vertex));
    }
    point_vertex_attributes();
    glBindBuffer(GL_ARRAY_BUFFER, shape.uv);
    glEnableVertexAttribArray(kTextureUv);
    glVertexAttribPointer(kTextureUv, 2, GL_FLOAT, GL_FALSE, 0, nullptr);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, shape.index);
    glBindVertexArray(0);
}

void GlRenderer::Impl::upload_shape(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from) {
    const RenderMesh& mesh = static_mesh(from.mesh, false).mesh;
    const Vec3* position = snapshot.position.data() + from.vertices.first;
    const Vec3* normal = snapshot.normal.data() + from.vertices.first;
    const uint32_t* source = mesh.source.data();
    const size_t count = mesh.source.size();
    const bool was_damaged = buffers.damaged;
    stream<Vertex>(buffers.vertex, count, [&](Vertex* row) {
        float trouble = 0;  // 0 * x is not a number when x is not finite
        for (size_t i = 0; i < count; ++i) {
            const Vec3& p = position[source[i]];
            row[i] = make_vertex(p, normal[source[i]]);
            trouble += 0.0f * p.x() + 0.0f * p.y() + 0.0f * p.z();
        }
        buffers.damaged = trouble != 0;
    });
    if (!buffers.damaged && !was_damaged) return;
    glBindVertexArray(buffers.array);
    if (buffers.damaged) {
        std::vector<Vertex> row;
        for (size_t i = 0; i < count; ++i) row.push_back(make_vertex(position[source[i]], normal[source[i]]));
        const std::vector<uint32_t> index = finite_triangles(mesh, row.data(), buffers.patched_groups);
        reserve(buffers.patched, GL_ELEMENT_ARRAY_BUFFER, std::max<size_t>(index.size(), 1) * 4);
        glBufferSubData(GL_ELEMENT_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(index.size() * 4), index.data());
    } else {
        glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, static_mesh(from.mesh, false).index);
    }
    glBindVertexArray(0);
}

void GlRenderer::Impl::upload_depths(BodyBuffers& buffers, const PictureSnapshot& snapshot, const PictureBody& from) {
    glBindVertexArray(buffers.array);
    if (from.depths.count == 0) {
        glDisableVertexAttribArray(kDepth);
        return;
    }
    const std::vector<uint32_t>& source = static_mesh(from.mesh, buffers.rigid).mesh.source;
    const float* depth = snapshot.contact_depth.data() + from.depths.first;
    stream<float>(buffers.depth, source.size(), [&](float* row) {
        for (size_t i = 0; i < source.size(); ++i) row[i] = depth[source[i]];
    });
    glEnableVertexAttribArray(kDepth);
    glVertexAttribPointer(kDepth, 1, GL_FLOAT, GL_FALSE, 0, nullptr);
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
        if (!is_rigid) upload_shape(buffers, snapshot, from);
        if (params.depth_colours) upload_depths(buffers, snapshot, from);
    }
    glBindVertexArray(0);
}

Matrix4 GlRenderer::Impl::body_pose(const View& view, const PictureBody& from, uint32_t row) {
    const Quat& q = from.orientation;
    Vec3d origin = from.origin - view.eye;
    if (body[row].rigid) origin += rotate(q, static_mesh(from.mesh, true).centre);
    return pose_matrix(rotate(q, Vec3d::UnitX()), rotate(q, Vec3d::UnitY()), rotate(q, Vec3d::UnitZ()), origin);
}

void GlRenderer::Impl::set_pose(const View& view, const Matrix4& pose) {
    const SurfaceProgram& p = programs.surface;
    glUniformMatrix4fv(p.clip_from_body, 1, GL_FALSE, multiply(view.view_projection, pose).data());
    glUniformMatrix4fv(p.eye_from_body, 1, GL_FALSE, pose.data());
    glUniformMatrix3fv(p.normal_from_body, 1, GL_FALSE, normal_matrix(pose).data());
}

void GlRenderer::Impl::set_material(const Material& material, GLuint image) {
    const SurfaceProgram& p = programs.surface;
    // tissue and steel are never quite dull: a floor under the highlight keeps shapes readable
    const auto wet = [](float s) { return std::clamp(s, 0.06f, 1.0f); };
    glUniform3f(p.diffuse, material.diffuse[0], material.diffuse[1], material.diffuse[2]);
    glUniform3f(p.specular, wet(material.specular[0]), wet(material.specular[1]), wet(material.specular[2]));
    glUniform1f(p.shine, 12.0f + 116.0f * std::clamp(material.shininess, 0.0f, 1.0f));
    glUniform1f(p.opacity, 1.0f - std::clamp(material.transparency, 0.0f, 1.0f));
    glUniform1i(p.textured, image != 0);
    if (image) glBindTexture(GL_TEXTURE_2D, image);
}

void GlRenderer::Impl::begin_surfaces(const PictureParams& params, const View& view) {
    const SurfaceProgram& p = programs.surface;
    const auto basis = [&](float x, float y, float z) {
        Vec3 v = x * Vec3(view.right.data()) + y * Vec3(view.up.data()) + z * Vec3(view.forward.data());
        return Vec3(v.normalized());
    };
    const Vec3 key = basis(-0.45f, 0.80f, -0.65f), fill = basis(0.85f, 0.10f, -0.35f);
    glUseProgram(p.name);
    glUniform3fv(p.key, 1, key.data());
    glUniform3fv(p.fill, 1, fill.data());
    glUniform3fv(p.sky, 1, view.sky.data());
    glUniform3fv(p.forward, 1, view.forward.data());
    glUniform1i(p.light_at_eye, view.light_at_eye);
    glUniform1f(p.light_distance, view.light_distance);
    glUniform1i(p.depth_colours, params.depth_colours);
    glUniform1f(p.inv_depth_scale, static_cast<float>(1.0 / std::max(params.depth_scale, 1e-12)));
    glUniform1i(p.image, 0);
    glUniform1i(p.palette, 1);
    glActiveTexture(GL_TEXTURE1);
    glBindTexture(GL_TEXTURE_2D, palette);
    glActiveTexture(GL_TEXTURE0);
    glVertexAttrib1f(kDepth, 0);
    glVertexAttrib2f(kTextureUv, 0, 0);
}

void GlRenderer::Impl::draw_background(const PictureParams& params, const View& view, const Ground& ground) {
    const float width = static_cast<float>(params.width), height = static_cast<float>(params.height);
    glBindVertexArray(empty_array);
    glDisable(GL_DEPTH_TEST);
    glUseProgram(programs.background);
    glUniform2f(programs.background_size, width, height);
    glUniform1i(programs.background_scope, view.light_at_eye);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    if (!ground.on) return;
    const uint32_t count = std::min(kGroundShadows, static_cast<uint32_t>(ground.shadows.size()));
    std::array<float, 4 * kGroundShadows> shape{};
    std::array<float, 2 * kGroundShadows> rest{};
    for (uint32_t i = 0; i < count; ++i) {
        const GroundShadow& s = ground.shadows[i];
        std::copy_n(std::array{s.x, s.y, s.xx, s.xy}.begin(), 4, shape.begin() + 4 * i);
        std::copy_n(std::array{s.yy, s.darkness}.begin(), 2, rest.begin() + 2 * i);
    }
    glEnable(GL_BLEND);
    glEnable(GL_DEPTH_CLAMP);  // the floor reaches beyond the planes that enclose the scene
    glUseProgram(programs.ground);
    glUniformMatrix4fv(programs.ground_view, 1, GL_FALSE, view.view_projection.data());
    glUniform3fv(programs.ground_centre, 1, floats(ground.centre - view.eye).data());
    glUniform3fv(programs.ground_x, 1, floats(ground.axis_x).data());
    glUniform3fv(programs.ground_y, 1, floats(ground.axis_y).data());
    glUniform1f(programs.ground_radius, static_cast<float>(ground.radius));
    glUniform1i(programs.ground_shadows, static_cast<GLint>(count));
    glUniform4fv(programs.ground_shape, kGroundShadows, shape.data());
    glUniform2fv(programs.ground_rest, kGroundShadows, rest.data());
    glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
    glDisable(GL_DEPTH_CLAMP);
    glDisable(GL_BLEND);
}

void GlRenderer::Impl::draw_surfaces(const PictureParams& params, const View& view, const PictureSnapshot& snapshot,
                                     bool opaque) {
    begin_surfaces(params, view);
    for (uint32_t row = 0; row < snapshot.body.size(); ++row) {
        const PictureBody& from = snapshot.body[row];
        if (from.mesh == kNone) continue;
        const std::vector<RenderGroup>& groups =
            body[row].damaged ? body[row].patched_groups : static_mesh(from.mesh, body[row].rigid).mesh.groups;
        const Range materials = meshes.materials[from.mesh];
        bool posed = false;
        for (const RenderGroup& group : groups) {
            const bool known = group.material < materials.count;
            const Material& material = known ? meshes.material[materials.first + group.material] : plain;
            if (group.count == 0 || (material.transparency <= 0) != opaque) continue;
            if (!posed) {
                set_pose(view, body_pose(view, from, row));
                glBindVertexArray(body[row].array);
                posed = true;
            }
            set_material(material, known ? texture[materials.first + group.material] : 0);
            glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(group.count), GL_UNSIGNED_INT,
                           reinterpret_cast<const void*>(size_t{4} * group.first));
        }
    }
}

void GlRenderer::Impl::draw_wires(const View& view, const PictureSnapshot& snapshot) {
    glUseProgram(programs.wire);
    glUniform1f(programs.wire_pull, view.view_projection[14] * (1.0f / 0.999f - 1.0f));
    for (uint32_t row = 0; row < snapshot.body.size(); ++row) {
        const PictureBody& from = snapshot.body[row];
        if (from.mesh == kNone || body[row].damaged) continue;
        const RenderMesh& mesh = static_mesh(from.mesh, body[row].rigid).mesh;
        if (mesh.line.empty()) continue;
        glUniformMatrix4fv(programs.wire_clip, 1, GL_FALSE,
                           multiply(view.view_projection, body_pose(view, from, row)).data());
        glUniform4f(programs.wire_plain, 0.008f, 0.012f, 0.02f, 0.42f);
        glBindVertexArray(body[row].array);
        glDrawElements(GL_LINES, static_cast<GLsizei>(mesh.line.size()), GL_UNSIGNED_INT,
                       reinterpret_cast<const void*>(size_t{4} * mesh.index.size()));
    }
}

void GlRenderer::Impl::draw_marker(const View& view, const Marker& m) {
    const Vec3d from = m.from - view.eye;
    if (!from.allFinite() || !m.to.allFinite() || !(m.radius > 0)) return;
    const auto draw = [](GLsizei count, GLsizei first) {
        glDrawElements(GL_TRIANGLES, count, GL_UNSIGNED_INT,
                       reinterpret_cast<const void*>(size_t{4} * static_cast<size_t>(first)));
    };
    if (m.kind == Marker::Kind::kSphere) {
        const Vec3d x = m.radius * Vec3d::UnitX(), y = m.radius * Vec3d::UnitY(), z = m.radius * Vec3d::UnitZ();
        set_pose(view, pose_matrix(x, y, z, from));
        draw(marker.sphere_count, 0);
        return;
    }
    const Vec3d along = m.to - m.from;
    const double length = along.norm();
    if (!(length > 0)) return;
    const Vec3d z = along / length;
    Vec3d x, y;
    perpendicular_axes(z, x, y);
    const double head = std::min(0.5 * length, 5 * m.radius), shaft = length - head;
    set_pose(view, pose_matrix(m.radius * x, m.radius * y, shaft * z, from));
    draw(marker.shaft_count, marker.sphere_count);
    set_pose(view, pose_matrix(2.4 * m.radius * x, 2.4 * m.radius * y, head * z, from + shaft * z));
    draw(marker.head_count, marker.sphere_count + marker.shaft_count);
}

void GlRenderer::Impl::draw_markers(const PictureParams& params, const View& view, std::span<const Marker> markers) {
    PictureParams plain = params;
    plain.depth_colours = false;
    begin_surfaces(plain, view);
    glBindVertexArray(marker.array);
    // faint where tissue hides them, then full where nothing does
    for (const bool hidden : {true, false}) {
        glDepthFunc(hidden ? GL_GREATER : GL_LEQUAL);
        glDepthMask(hidden ? GL_FALSE : GL_TRUE);
        for (const Marker& m : markers) {
            Material material;
            material.diffuse = {m.colour[0], m.colour[1], m.colour[2]};
            material.specular = {0.2f, 0.2f, 0.2f};
            material.shininess = 0.5f;
            material.transparency = 1.0f - m.colour[3] * (hidden ? 0.30f : 1.0f);
            set_material(material, 0);
            draw_marker(view, m);
        }
    }
    glDepthFunc(GL_LESS);
}

void GlRenderer::Impl::read_back(Image& out) {
    const GLsizei width = static_cast<GLsizei>(target.width), height = static_cast<GLsizei>(target.height);
    if (target.resolved) {
        glBindFramebuffer(GL_READ_FRAMEBUFFER, target.drawn);
        glBindFramebuffer(GL_DRAW_FRAMEBUFFER, target.resolved);
        glBlitFramebuffer(0, 0, width, height, 0, 0, width, height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    }
    glBindFramebuffer(GL_FRAMEBUFFER, target.resolved ? target.resolved : target.drawn);
    out.width = target.width;
    out.height = target.height;
    const size_t row = size_t{4} * target.width;
    out.rgba.resize(row * target.height);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, out.rgba.data());
    // OpenGL's first row is the lowest
    row_copy.resize(row);
    for (size_t top = 0, bottom = target.height - 1; top < bottom; ++top, --bottom) {
        uint8_t* a = out.rgba.data() + top * row;
        uint8_t* b = out.rgba.data() + bottom * row;
        std::memcpy(row_copy.data(), a, row);
        std::memcpy(a, b, row);
        std::memcpy(b, row_copy.data(), row);
    }
}

GlRenderer::GlRenderer(const Meshes& meshes) : impl_(std::make_unique<Impl>(meshes)) {
    impl_->context.make_current();
    impl_->programs = make_programs();
    impl_->marker = make_marker_mesh();
    impl_->palette = make_palette();
    glGenVertexArrays(1, &impl_->empty_array);
    impl_->context.release();
}

GlRenderer::~GlRenderer() = default;

void GlRenderer::draw(const PictureParams& params, const View& view, const PictureSnapshot& snapshot,
                      std::span<const Marker> markers, const Ground& ground, Image& out) {
    Impl& gl = *impl_;
    gl.context.make_current();
    gl.resize(params);
    gl.upload(snapshot, params);
    glBindFramebuffer(GL_FRAMEBUFFER, gl.target.drawn);
    glViewport(0, 0, static_cast<GLsizei>(params.width), static_cast<GLsizei>(params.height));
    glEnable(GL_FRAMEBUFFER_SRGB);
    glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    glDepthMask(GL_TRUE);
    glClearColor(0, 0, 0, 1);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_FALSE);  // the picture stays opaque whatever is blended into it
    glBlendFunc(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA);
    gl.draw_background(params, view, ground);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_LESS);
    gl.draw_surfaces(params, view, snapshot, true);
    glEnable(GL_BLEND);
    glDepthMask(GL_FALSE);
    if (params.wireframe) gl.draw_wires(view, snapshot);
    gl.draw_surfaces(params, view, snapshot, false);
    if (!markers.empty()) gl.draw_markers(params, view, markers);
    if (view.light_at_eye) {
        glDisable(GL_DEPTH_TEST);
        glBindVertexArray(gl.empty_array);
        glUseProgram(gl.programs.mask);
        glUniform2f(gl.programs.mask_size, static_cast<float>(params.width), static_cast<float>(params.height));
        glDrawArrays(GL_TRIANGLES, 0, 3);
    }
    glDisable(GL_BLEND);
    gl.read_back(out);
    glBindVertexArray(0);
    gl.context.release();
}

}  // namespace trocar
