#pragma once
namespace trocar::shaders {

// Surfaces and markers. All vectors are in world axes relative to the eye; colours are linear.
inline constexpr const char* kSurfaceVertex = R"(#version 330 core
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in float depth;
uniform mat4 clip_from_body, eye_from_body;
uniform mat3 normal_from_body;
out vec3 at, outward;
out vec2 texture_uv;
out float contact_depth;
void main() {
    at = (eye_from_body * vec4(position, 1.0)).xyz;
    outward = normal_from_body * normal;
    texture_uv = uv;
    contact_depth = depth;
    gl_Position = clip_from_body * vec4(position, 1.0);
}
)";

inline constexpr const char* kSurfaceFragment = R"(#version 330 core
in vec3 at, outward;
in vec2 texture_uv;
in float contact_depth;
uniform vec3 diffuse, specular;
uniform float shine, opacity;
uniform bool textured, depth_colours, light_at_eye;
uniform float inv_depth_scale, light_distance;
uniform vec3 key, fill, sky, forward;
uniform sampler2D image, palette;
out vec4 colour;

vec3 facing_normal(vec3 to_eye) {
    if (dot(outward, outward) > 0.25) return normalize(gl_FrontFacing ? outward : -outward);
    vec3 flat_normal = cross(dFdx(at), dFdy(at));
    float size = dot(flat_normal, flat_normal);
    if (!(size > 0.0)) return to_eye;
    flat_normal *= inversesqrt(size);
    return dot(flat_normal, to_eye) < 0.0 ? -flat_normal : flat_normal;
}

// Blinn 1977, scaled so that a tighter highlight is a brighter one, with Schlick's 1994 Fresnel factor.
vec3 highlight(vec3 n, vec3 to_light, vec3 to_eye) {
    vec3 h = normalize(to_light + to_eye);
    float fresnel = pow(1.0 - max(dot(h, to_eye), 0.0), 5.0);
    float size = shine * 0.06 + 0.4;
    return (specular + (1.0 - specular) * fresnel) * size * pow(max(dot(n, h), 0.0), shine);
}

vec3 studio(vec3 n, vec3 to_eye, vec3 base) {
    float key_light = max((dot(n, key) + 0.2) / 1.2, 0.0);
    float fill_light = max(dot(n, fill), 0.0);
    vec3 ambient = mix(vec3(0.10, 0.085, 0.08), vec3(0.24, 0.26, 0.29), dot(n, sky) * 0.5 + 0.5);
    vec3 light = ambient + key_light * vec3(0.88, 0.84, 0.78) + fill_light * vec3(0.13, 0.16, 0.20);
    float lit = smoothstep(0.0, 0.15, dot(n, key));
    vec3 shine_on = lit * highlight(n, key, to_eye) + 0.25 * highlight(n, fill, to_eye);
    float rim = pow(1.0 - max(dot(n, to_eye), 0.0), 3.0);
    vec3 edge = rim * (0.22 * base + vec3(0.035, 0.04, 0.045)) * (0.6 + 0.4 * dot(n, sky));
    return base * light + shine_on + edge;
}

vec3 scope(vec3 n, vec3 to_eye, vec3 base) {
    float distance2 = max(dot(at, at), 1e-12);
    float falloff = min(light_distance * light_distance / distance2, 2.2);
    float cone = smoothstep(0.55, 0.98, dot(forward, -to_eye));
    float facing = max(dot(n, to_eye), 0.0);
    vec3 lamp = vec3(1.0, 0.97, 0.92) * falloff * (0.25 + 0.75 * cone);
    return base * (lamp * (0.08 + 0.92 * facing) + vec3(0.012)) + lamp * highlight(n, to_eye, to_eye);
}

void main() {
    vec3 to_eye = -normalize(at);
    vec3 n = facing_normal(to_eye);
    vec3 base = diffuse;
    float cover = opacity;
    if (textured) {
        vec4 texel = texture(image, texture_uv);
        base *= texel.rgb;
        cover *= texel.a;
    }
    if (depth_colours) {
        float grey = dot(base, vec3(0.2126, 0.7152, 0.0722));
        float t = clamp(contact_depth * inv_depth_scale, 0.0, 1.0);
        vec3 calm = mix(vec3(0.30, 0.33, 0.36), vec3(sqrt(grey)) * 0.6, 0.5);
        base = mix(calm, texture(palette, vec2(t * 0.99609375 + 0.001953125, 0.5)).rgb, smoothstep(0.0, 0.03, t));
    }
    vec3 c = light_at_eye ? scope(n, to_eye, base) : studio(n, to_eye, base);
    // highlights roll off instead of clipping
    c = mix(c, 0.75 + 0.25 * (1.0 - exp(-(c - 0.75) / 0.25)), step(0.75, c));
    colour = vec4(c, cover);
}
)";

// Mesh edges drawn over the surface. `pull` is the depth term of a view scaled about the eye by 0.999, which leaves the
// projection as it is and brings the lines a thousandth of their distance in front of the surface.
inline constexpr const char* kWireVertex = R"(#version 330 core
layout(location = 0) in vec3 position;
uniform mat4 clip_from_body;
uniform float pull;
void main() {
    gl_Position = clip_from_body * vec4(position, 1.0);
    gl_Position.z += pull;
}
)";
inline constexpr const char* kPlainFragment = R"(#version 330 core
uniform vec4 plain;
out vec4 colour;
void main() { colour = plain; }
)";

// One triangle that covers the picture.
inline constexpr const char* kCoverVertex = R"(#version 330 core
void main() {
    vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
    gl_Position = vec4(corner, 0.0, 1.0);
}
)";

// Vertical gradient with a soft glow behind the scene, and less than a step of noise against banding.
inline constexpr const char* kBackgroundFragment = R"(#version 330 core
uniform vec2 size;
uniform bool light_at_eye;
out vec4 colour;
void main() {
    vec2 p = gl_FragCoord.xy / size;
    float glow = exp(-2.2 * dot(p - vec2(0.5, 0.55), p - vec2(0.5, 0.55)));
    vec3 encoded = mix(vec3(0.135, 0.150, 0.175), vec3(0.235, 0.270, 0.315), p.y) + 0.16 * glow;
    if (light_at_eye) encoded = vec3(0.055, 0.028, 0.024) + 0.05 * glow;
    float noise = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
    encoded += (noise - 0.5) / 255.0;
    colour = vec4(pow((encoded + 0.055) / 1.055, vec3(2.4)), 1.0);
}
)";

inline constexpr const char* kGroundVertex = R"(#version 330 core
uniform mat4 view_projection;
uniform vec3 centre, axis_x, axis_y;
uniform float radius;
out vec2 floor_at;
void main() {
    vec2 corner = vec2((gl_VertexID & 1) == 0 ? -1.0 : 1.0, (gl_VertexID & 2) == 0 ? -1.0 : 1.0);
    floor_at = corner * radius;
    gl_Position = view_projection * vec4(centre + floor_at.x * axis_x + floor_at.y * axis_y, 1.0);
}
)";
inline constexpr const char* kGroundFragment = R"(#version 330 core
in vec2 floor_at;
uniform float radius;
uniform int shadows;
uniform vec4 shadow_shape[8];  // centre x, y, then xx, xy
uniform vec2 shadow_rest[8];   // yy, darkness
out vec4 colour;
void main() {
    float far = length(floor_at) / radius;
    float light = 1.0;
    for (int i = 0; i < shadows; ++i) {
        vec2 d = floor_at - shadow_shape[i].xy;
        float q = shadow_shape[i].z * d.x * d.x + 2.0 * shadow_shape[i].w * d.x * d.y + shadow_rest[i].x * d.y * d.y;
        light *= 1.0 - shadow_rest[i].y * exp(-0.5 * q);
    }
    float fade = 1.0 - smoothstep(0.15, 1.0, far);
    colour = vec4(vec3(0.135, 0.150, 0.170) * light, fade);
}
)";

// Round picture of a laparoscope: black outside, darker towards the rim.
inline constexpr const char* kMaskFragment = R"(#version 330 core
uniform vec2 size;
out vec4 colour;
void main() {
    float r = length(gl_FragCoord.xy - 0.5 * size) / (0.535 * min(size.x, size.y));
    float edge = 1.5 / (0.535 * min(size.x, size.y));
    float outside = smoothstep(1.0 - edge, 1.0 + edge, r);
    float shade = 0.55 * smoothstep(0.55, 1.05, r);
    colour = vec4(vec3(0.0015), mix(shade, 1.0, outside));
}
)";

}  // namespace trocar::shaders
