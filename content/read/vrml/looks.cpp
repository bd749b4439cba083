#include "content/read/vrml/looks.hpp"

#include <algorithm>
#include <cmath>

#include "content/text/texture.hpp"
#include "engine/files/text_file.hpp"
namespace trocar::vrml {
namespace {

constexpr size_t kMaterialLimit = 65535;
constexpr uint64_t kImageBytesLimit = uint64_t{1} << 30;

// Entry k of a colour field, cyclic if there are fewer; NaN and values outside 0..1 are clamped.
void read_colour(std::span<const double> numbers, uint32_t entry, std::array<float, 3>& colour) {
    const size_t entries = numbers.size() / 3;
    if (entries == 0) return;
    for (size_t c = 0; c < 3; ++c) {
        const double value = numbers[3 * (entry % entries) + c];
        colour[c] = value >= 0 ? static_cast<float>(std::min(value, 1.0)) : 0.0f;
    }
}

void read_share(std::span<const double> numbers, uint32_t entry, float& share) {
    if (numbers.empty()) return;
    const double value = numbers[entry % numbers.size()];
    share = value >= 0 ? static_cast<float>(std::min(value, 1.0)) : 0.0f;
}

// The inline image of a texture node: width, height, channels, one number per pixel, bottom row first.
Image read_pixels(std::span<const double> numbers) {
    Image image;
    if (numbers.size() < 3) return image;
    const double width = numbers[0], height = numbers[1], channels = numbers[2];
    if (!(width >= 1 && height >= 1 && width * height <= static_cast<double>(numbers.size() - 3))) return image;
    if (!(channels >= 1 && channels <= 4)) return image;
    image.width = static_cast<uint32_t>(width);
    image.height = static_cast<uint32_t>(height);
    const int count = static_cast<int>(channels);
    image.rgba.resize(size_t{4} * image.width * image.height);
    for (uint32_t y = 0; y < image.height; ++y) {
        for (uint32_t x = 0; x < image.width; ++x) {
            const double number = numbers[3 + size_t{image.height - 1 - y} * image.width + x];
            const auto packed = number >= 0 && number <= 4294967295.0 ? static_cast<uint32_t>(number) : 0u;
            const auto byte = [&](int k) { return static_cast<uint8_t>(packed >> (8 * (count - 1 - k)) & 0xff); };
            uint8_t* p = image.rgba.data() + 4 * (size_t{y} * image.width + x);
            for (int c = 0; c < 3; ++c) p[c] = byte(count < 3 ? 0 : c);
            p[3] = count == 2 ? byte(1) : count == 4 ? byte(3) : 255;
        }
    }
    return image;
}

// File name and pixels of a texture node, loaded once: the first of its files that can be read.
const std::pair<std::string, Image>& texture_of(SurfaceBuilder& b, NodeId id) {
    const auto [found, fresh] = b.texture.try_emplace(id);
    if (!fresh || id.node == kNone || role_of(b.scene, id) != Role::kTexture) return found->second;
    Value name = find_value(b.scene, id, "url");
    if (!name) name = find_value(b.scene, id, "filename");
    const std::vector<std::string> urls = urls_of(name);
    if (urls.empty()) {
        found->second.second = read_pixels(numbers_at(b.scene, id, "image"));
        if (found->second.second.width > 0) found->second.first = "pixels";
        return found->second;
    }
    const Document& document = b.scene.file[id.document]->document;
    std::string first_trouble;
    for (const std::string& url : urls) {
        Material material;
        material.texture = url;
        const std::string trouble = load_texture(b.scene.roots, document.path.parent_path(), material);
        if (trouble.empty()) {
            found->second = {url, std::move(material.image)};
            return found->second;
        }
        if (first_trouble.empty()) first_trouble = trouble;
    }
    if (first_time(b.scene, "texture " + urls[0])) {
        b.scene.warnings.push_back(describe_location(document, name.field->offset) + ": " + first_trouble);
    }
    found->second.first = urls[0];
    return found->second;
}

uint16_t add_material(SurfaceBuilder& b, Material material, NodeId texture) {
    const std::array<float, 3>&d = material.diffuse, &s = material.specular;
    const auto& [name, image] = b.texture.at(texture);
    const std::array<float, 8> look{d[0], d[1], d[2], s[0], s[1], s[2], material.shininess, material.transparency};
    const auto key = std::pair{look, name.empty() ? NodeId{} : texture};
    const auto found = b.material_of_look.find(key);
    if (found != b.material_of_look.end()) return found->second;
    if (b.mesh.material.size() >= kMaterialLimit) {
        if (first_time(b.scene, "materials")) {
            b.scene.warnings.push_back(b.scene.file[0]->document.path.string() + ": more than " + std::to_string(kMaterialLimit) +
                                       " materials; the rest look like the last");
        }
        return static_cast<uint16_t>(kMaterialLimit - 1);
    }
    material.texture = name;
    // each material has its own copy of the pixels: many materials with one image must not exhaust memory
    b.image_bytes += image.rgba.size();
    if (b.image_bytes <= kImageBytesLimit) {
        material.image = image;
    } else if (first_time(b.scene, "image bytes")) {
        b.scene.warnings.push_back(b.scene.file[0]->document.path.string() + ": textures need more than " +
                                   describe_bytes(kImageBytesLimit) + "; the rest are left out");
    }
    b.mesh.material.push_back(std::move(material));
    const auto row = static_cast<uint16_t>(b.mesh.material.size() - 1);
    b.material_of_look.emplace(key, row);
    return row;
}

FaceLook choose_look(SurfaceBuilder& b, const Instance& instance) {
    FaceLook look;
    const NodeId id = instance.geometry;
    const NodeId colour = first_node(b.scene, find_value(b.scene, id, "color"));
    if (colour.node != kNone && role_of(b.scene, colour) == Role::kColor) {
        if (flag_of(find_value(b.scene, id, "colorPerVertex"), true)) {
            if (first_time(b.scene, "colours of vertices")) {
                b.scene.warnings.push_back(position_of(b.scene, colour) + ": colours of vertices are passed over");
            }
        } else if (const size_t entries = numbers_at(b.scene, colour, "color").size() / 3; entries > 0) {
            return {true, numbers_at(b.scene, id, "colorIndex"), static_cast<uint32_t>(entries), colour, 0};
        }
    }
    if (instance.state.material_binding.node == kNone || instance.state.material.node == kNone) return look;
    const std::string binding = text_of(find_value(b.scene, instance.state.material_binding, "value"));
    if (binding.starts_with("PER_VERTEX") && first_time(b.scene, "materials of vertices")) {
        b.scene.warnings.push_back(position_of(b.scene, instance.state.material_binding) +
                                   ": materials of vertices are passed over; the first is used");
    }
    look.per_face = binding.starts_with("PER_FACE") || binding.starts_with("PER_PART");
    if (binding.ends_with("_INDEXED")) look.index = numbers_at(b.scene, id, "materialIndex");
    size_t entries = 1;
    for (const char* name : {"diffuseColor", "specularColor"}) {
        entries = std::max(entries, numbers_at(b.scene, instance.state.material, name).size() / 3);
    }
    entries = std::max(entries, numbers_at(b.scene, instance.state.material, "transparency").size());
    look.entries = static_cast<uint32_t>(entries);
    return look;
}

}  // namespace

uint16_t material_row(SurfaceBuilder& b, const State& state, uint32_t entry, NodeId colour_node) {
    const NodeId source = colour_node.node != kNone ? colour_node : state.material;
    const auto key = std::tuple{state.material, source, state.texture, entry};
    const auto found = b.material_row.find(key);
    if (found != b.material_row.end()) return found->second;
    Material material;
    const uint32_t base = colour_node.node != kNone ? 0 : entry;
    if (state.material.node != kNone && role_of(b.scene, state.material) == Role::kMaterial) {
        const NodeId id = state.material;
        material.name = printable(text_of(b.scene.file[id.document]->document, node_of(b.scene, id).name));
        read_colour(numbers_at(b.scene, id, "diffuseColor"), base, material.diffuse);
        read_colour(numbers_at(b.scene, id, "specularColor"), base, material.specular);
        read_share(numbers_at(b.scene, id, "shininess"), base, material.shininess);
        read_share(numbers_at(b.scene, id, "transparency"), base, material.transparency);
    }
    if (colour_node.node != kNone) read_colour(numbers_at(b.scene, colour_node, "color"), entry, material.diffuse);
    texture_of(b, state.texture);
    const uint16_t row = add_material(b, std::move(material), state.texture);
    b.material_row.emplace(key, row);
    return row;
}

FaceLook face_look(SurfaceBuilder& b, const Instance& instance) {
    FaceLook look = choose_look(b, instance);
    if (!look.per_face) look.whole = material_row(b, instance.state, 0, {});
    return look;
}

uint16_t material_of_face(SurfaceBuilder& b, const State& state, const FaceLook& look, uint64_t face) {
    if (!look.per_face) return look.whole;
    double entry = static_cast<double>(face);
    if (!look.index.empty()) entry = face < look.index.size() ? look.index[face] : 0;
    if (!(entry >= 0 && entry < 4294967296.0)) entry = 0;
    return material_row(b, state, static_cast<uint32_t>(entry) % look.entries, look.colour);
}

}  // namespace trocar::vrml
