#pragma once
namespace trocar::shaders {

// The software renderer executes both sides of a branch, so every choice constant in a draw call is a macro:
// TEXTURED, DEPTH_COLOURS, SCOPE (laparoscope), LAMP (its light is beside the lens), OUTLINE (only surfaces seen edge-on). This precedes every
// shader.
inline constexpr const char* kVersion = "#version 330 core\n";

// Round picture of a laparoscope: 1 inside, 0 outside, darker towards the rim.
inline constexpr const char* kMask = R"(
uniform vec2 size;
float mask() {
#ifdef SCOPE
    float radius = 0.535 * min(size.x, size.y);
    float r = length(gl_FragCoord.xy - 0.5 * size) / radius;
    float edge = 1.0 / radius;
    return (1.0 - 0.6 * smoothstep(0.5, 1.05, r)) * (1.0 - smoothstep(1.0 - edge, 1.0 + edge, r));
#else
    return 1.0;
#endif
}
)";

// Surfaces and markers. All vectors are in world axes relative to the eye; colours are linear. Few varyings,
// because each costs triangle set-up; the view direction is derived from the pixel instead.
inline constexpr const char* kSurfaceVertex = R"(
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in float depth;
uniform mat4 clip_from_body;
uniform mat3 normal_from_body;
out vec3 outward;
#ifdef WET
layout(location = 4) in vec4 liquid;  // thickness, height of its surface, how level it stands, share of blood
uniform vec3 up;
out vec2 film;
#endif
#ifdef TEXTURED
out vec2 texture_uv;
#endif
#ifdef DEPTH_COLOURS
out float contact_depth;
#endif
#ifdef BURNT
out float burnt;
#endif
void main() {
    outward = normal_from_body * normal;
#ifdef TEXTURED
    texture_uv = uv;
#endif
#ifdef DEPTH_COLOURS
    contact_depth = depth;
#endif
#ifdef BURNT
    burnt = depth;
#endif
#ifdef WET
    film = liquid.xw;
    outward = normal_from_body * mix(normal, up, liquid.z);
    vec3 over = mix(min(liquid.x, 0.003) * normal, liquid.y * up, liquid.z);
    gl_Position = clip_from_body * vec4(position + over, 1.0);
#else
    gl_Position = clip_from_body * vec4(position, 1.0);
#endif
}
)";

inline constexpr const char* kSurfaceFragment = R"(
in vec3 outward;
#ifdef TEXTURED
in vec2 texture_uv;
uniform sampler2D image;
#endif
#ifdef DEPTH_COLOURS
in float contact_depth;
uniform float inv_depth_scale;
uniform sampler2D palette;
#endif
#ifdef BURNT
in float burnt;
#endif
#ifdef WET
in vec2 film;
vec3 mirror;
float polish;
#define specular mirror
#define shine polish
uniform vec3 diffuse;
#else
uniform vec3 diffuse, specular;
#endif
#ifndef WET
uniform float shine;
#endif
uniform float opacity;
uniform float light_distance;
uniform vec3 key, fill, sky, forward;
uniform vec3 ray_corner, ray_x, ray_y;  // a pixel at distance 1 along forward, relative to the eye
out vec4 colour;

// Blinn 1977 with the power written as a Gaussian of the same width, scaled so that a tighter highlight is a brighter
// one, and Schlick's 1994 Fresnel factor.
vec3 highlight(vec3 n, vec3 to_light, vec3 to_eye) {
    vec3 h = to_light + to_eye;
    h *= inversesqrt(max(dot(h, h), 1e-8));
    float grazing = 1.0 - max(dot(h, to_eye), 0.0);
    float grazing2 = grazing * grazing;
    float fresnel = grazing2 * grazing2 * grazing;
    float size = shine * 0.022 + 0.4;
    return (specular + (1.0 - specular) * fresnel) * (size * exp2(1.442695 * shine * (dot(n, h) - 1.0)));
}

#ifdef LAMP
uniform vec3 lamp_at;  // relative to the eye
// The same spot light from beside the lens.
vec3 light(vec3 n, vec3 to_eye, float distance2, vec3 base) {
    vec3 to_lamp = lamp_at + to_eye * sqrt(distance2);
    float lamp2 = max(dot(to_lamp, to_lamp), 1e-12);
    to_lamp *= inversesqrt(lamp2);
    float falloff = min(light_distance * light_distance / lamp2, 2.2);
    float cone = smoothstep(0.55, 0.98, dot(forward, -to_lamp));
    float facing = max(dot(n, to_lamp), 0.0);
    vec3 lamp = vec3(1.0, 0.97, 0.92) * (falloff * (0.25 + 0.75 * cone));
    return base * (lamp * (0.08 + 0.92 * facing) + vec3(0.012)) + lamp * highlight(n, to_lamp, to_eye);
}
#elif defined(SCOPE)
vec3 light(vec3 n, vec3 to_eye, float distance2, vec3 base) {
    float falloff = min(light_distance * light_distance / distance2, 2.2);
    float cone = smoothstep(0.55, 0.98, dot(forward, -to_eye));
    float facing = max(dot(n, to_eye), 0.0);
    vec3 lamp = vec3(1.0, 0.97, 0.92) * (falloff * (0.25 + 0.75 * cone));
    return base * (lamp * (0.08 + 0.92 * facing) + vec3(0.012)) + lamp * highlight(n, to_eye, to_eye);
}
#else
vec3 light(vec3 n, vec3 to_eye, float distance2, vec3 base) {
    float key_cosine = dot(n, key);
    float up = dot(n, sky) * 0.5 + 0.5;
    vec3 ambient = mix(vec3(0.10, 0.085, 0.08), vec3(0.24, 0.26, 0.29), up);
    vec3 lamps = ambient + max((key_cosine + 0.2) / 1.2, 0.0) * vec3(0.88, 0.84, 0.78) +
                 max(dot(n, fill), 0.0) * vec3(0.13, 0.16, 0.20);
    vec3 shine_on = clamp(key_cosine * 7.0, 0.0, 1.0) * highlight(n, key, to_eye);
    float rim = 1.0 - max(dot(n, to_eye), 0.0);
    rim *= rim * rim;
    return base * (lamps + 0.2 * rim * up) + shine_on + (rim * up) * vec3(0.06, 0.07, 0.08);
}
#endif

void main() {
    vec3 ray = ray_corner + gl_FragCoord.x * ray_x + gl_FragCoord.y * ray_y;
    float ray2 = dot(ray, ray);
    vec3 to_eye = -ray * inversesqrt(ray2);
    // a vertex without a normal is lit as if it faced the eye
    vec3 n = gl_FrontFacing ? outward : -outward;
    float n2 = dot(n, n);
    n = n2 > 0.05 ? n * inversesqrt(n2) : to_eye;
    vec3 base = diffuse;
    float cover = opacity;
#ifdef TEXTURED
    vec4 texel = texture(image, texture_uv);
    // sRGB to linear as a cubic, off by at most 0.002; after filtering, which keeps the fast path of 8-bit textures
    base *= texel.rgb * (texel.rgb * (texel.rgb * 0.3053 + 0.6822) + 0.0125);
    cover *= texel.a;
#endif
#ifdef DEPTH_COLOURS
    float grey = dot(base, vec3(0.2126, 0.7152, 0.0722));
    float t = clamp(contact_depth * inv_depth_scale, 0.0, 1.0);
    vec3 calm = vec3(0.15, 0.165, 0.18) + 0.3 * sqrt(grey);
    base = mix(calm, texture(palette, vec2(t * 0.99609375 + 0.001953125, 0.5)).rgb, clamp(t * 40.0, 0.0, 1.0));
#endif
#ifdef BURNT
    base = mix(base, vec3(0.62, 0.55, 0.44), burnt);  // coagulated: whitish, the colour of cooked liver
#endif
#ifdef WET
    // Beer-Lambert there and back: absorption of blood of 150 g/l haemoglobin at 611, 549 and 464 nm (1/m), and the light that a deep
    // layer of it sends back; water takes none
    vec3 through = exp(-2.0 * film.x * film.y * vec3(810.0, 23000.0, 21000.0));
    base = mix(vec3(0.15, 0.006, 0.007), base, through);
    float gloss = smoothstep(0.0, 3e-5, film.x);
    mirror = mix(vec3(0.06), vec3(0.10), gloss);
    polish = mix(50.0, 260.0, gloss);
#endif
#ifdef OUTLINE
    cover *= smoothstep(0.45, 0.75, 1.0 - dot(n, to_eye));
#endif
    vec3 c = light(n, to_eye, ray2 / (gl_FragCoord.w * gl_FragCoord.w), base);
    // highlights roll off instead of clipping: c up to 0.75, then towards 1 with the same slope
    vec3 over = max(c - 0.75, 0.0);
    c = min(c, 0.75) + over / (1.0 + 4.0 * over);
    colour = vec4(c * mask(), cover);
}
)";

// Mesh edges drawn over the surface. `pull` is the depth term of a view scaled about the eye by 0.999, which
// keeps the projection and moves the lines towards the eye by a thousandth of their distance.
inline constexpr const char* kWireVertex = R"(layout(location = 0) in vec3 position;
uniform mat4 clip_from_body;
uniform float pull;
void main() {
    gl_Position = clip_from_body * vec4(position, 1.0);
    gl_Position.z += pull;
}
)";
inline constexpr const char* kPlainFragment = R"(uniform vec4 plain;
out vec4 colour;
void main() { colour = vec4(plain.rgb, plain.a * mask()); }
)";

// Smoke: what is behind it is dimmed by Beer-Lambert, and it scatters light itself.
inline constexpr const char* kSmokeVertex = R"(layout(location = 0) in vec3 position;
layout(location = 3) in float depth;
uniform mat4 clip_from_body;
out float optical_depth;
void main() {
    gl_Position = clip_from_body * vec4(position, 1.0);
    optical_depth = depth;
}
)";
inline constexpr const char* kSmokeFragment = R"(in float optical_depth;
uniform vec3 plain;
out vec4 colour;
void main() { colour = vec4(plain * mask(), 1.0 - exp2(-1.442695 * optical_depth)); }
)";

// One triangle that covers the picture.
inline constexpr const char* kCoverVertex = R"(void main() {
    vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
    gl_Position = vec4(corner, 0.0, 1.0);
}
)";

// Vertical gradient with a soft glow behind the scene, and noise of less than one quantisation step against
// banding. Drawn once and stored, with the floor.
inline constexpr const char* kBackgroundFragment = R"(
out vec4 colour;
void main() {
    vec2 p = gl_FragCoord.xy / size;
    float glow = exp(-2.2 * dot(p - vec2(0.5, 0.55), p - vec2(0.5, 0.55)));
#ifdef SCOPE
    vec3 encoded = vec3(0.10, 0.045, 0.04) + 0.06 * glow;
#else
    vec3 encoded = mix(vec3(0.135, 0.150, 0.175), vec3(0.235, 0.270, 0.315), p.y) + 0.16 * glow;
#endif
    float noise = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
    encoded += (noise - 0.5) / 255.0;
    colour = vec4(mask() * pow((encoded + 0.055) / 1.055, vec3(2.4)), 1.0);
}
)";

// A rectangle in the floor's plane: the floor itself, or the part with shadows.
inline constexpr const char* kGroundVertex = R"(
uniform mat4 view_projection;
uniform vec3 centre, axis_x, axis_y;
uniform vec4 rectangle;  // centre x, y, half sizes, m
out vec2 floor_at;       // m, from the rectangle's centre
out vec2 corner_uv;      // 0..1 over the rectangle
void main() {
    vec2 corner = vec2((gl_VertexID & 1) == 0 ? -1.0 : 1.0, (gl_VertexID & 2) == 0 ? -1.0 : 1.0);
    floor_at = corner * rectangle.zw;
    corner_uv = 0.5 + 0.5 * corner;
    vec2 p = rectangle.xy + floor_at;
    gl_Position = view_projection * vec4(centre + p.x * axis_x + p.y * axis_y, 1.0);
}
)";
inline constexpr const char* kGroundFragment = R"(
in vec2 floor_at;
uniform float radius;
out vec4 colour;
void main() {
    colour = vec4(0.135, 0.150, 0.170, 1.0 - smoothstep(0.15, 1.0, length(floor_at) / radius));
}
)";
inline constexpr const char* kShadowFragment = R"(
in vec2 corner_uv;
uniform sampler2D darkness;  // of the rectangle's cells
out vec4 colour;
void main() { colour = vec4(0.0, 0.0, 0.0, texture(darkness, corner_uv).r); }
)";

}  // namespace trocar::shaders
