#include "fuzz/random_scene.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <initializer_list>
#include <map>
#include <numbers>
#include <span>

#include "components/math.hpp"
#include "components/mesh.hpp"
#include "content/shapes/shape_library.hpp"
namespace trocar::fuzz {
namespace {

// splitmix64 (Steele, Lea, Flood, OOPSLA 2014): the same numbers everywhere, which the distributions of the standard
// library do not promise.
class Dice {
 public:
    explicit Dice(uint64_t seed) : state_(seed) {}
    double uniform(double low, double high) { return low + (high - low) * static_cast<double>(next() >> 11) * 0x1p-53; }
    double log_uniform(double low, double high) { return low * std::pow(high / low, uniform(0, 1)); }
    bool chance(double share) { return uniform(0, 1) < share; }
    size_t below(size_t count) { return static_cast<size_t>(next() % count); }
    template <typename T>
    T pick(std::initializer_list<T> list) {
        return list.begin()[below(list.size())];
    }

 private:
    uint64_t next() {
        uint64_t z = state_ += 0x9e3779b97f4a7c15ull;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
        return z ^ (z >> 31);
    }
    uint64_t state_;
};

// Four digits: the last bits of pow, which differ between libraries, do not show.
std::string number(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4g", value);
    return text;
}
std::string vector(const Vec3d& v) { return "[" + number(v.x()) + ", " + number(v.y()) + ", " + number(v.z()) + "]"; }

// m, lowest and highest corner of a shape whose largest extent is 1.
Box unit_box(const std::string& shape) {
    static std::map<std::string, Box> boxes;
    const auto known = boxes.find(shape);
    if (known != boxes.end()) return known->second;
    Box box;
    for (const Vec3d& p : make_shape(shape, 1000, 1, Looks::kPlain).position) box.min = box.min.cwiseMin(p), box.max = box.max.cwiseMax(p);
    const double extent = (box.max - box.min).maxCoeff();
    box.min /= extent, box.max /= extent;
    return boxes[shape] = box;
}

class Writer {
 public:
    explicit Writer(uint64_t seed) : dice_(seed ^ 0x7472'6f63'6172ull) {}

    RandomScene write() {
        wild_ = dice_.chance(0.55) ? 0 : dice_.chance(0.65) ? 1 : 2;
        scale_ = wild_ == 2 && dice_.chance(0.5) ? dice_.log_uniform(0.02, 20) : dice_.uniform(0.5, 1.5);
        jumble_ = dice_.chance(0.1);
        start_block();
        line(std::string("# ") +
             (wild_ == 0   ? "usual materials"
              : wild_ == 1 ? "a wild material"
                           : "wild materials") +
             (jumble_ ? ", starts overlapping" : ""));
        write_top();
        if (dice_.chance(0.8)) write_floor();
        const size_t bodies = 1 + dice_.below(4);
        for (size_t i = 0; i < bodies; ++i) write_body(i);
        const size_t tools = dice_.chance(0.5) ? 0 : dice_.chance(0.8) ? 1 : 2;
        for (size_t i = 0; i < tools; ++i) write_tool(i);
        write_attachments();
        return std::move(scene_);
    }

 private:
    struct Placed {
        std::string name;
        double size;
        Vec3d middle;
        bool deformable, may_be_cut;
    };

    void start_block() { scene_.block.emplace_back(); }
    void line(const std::string& text) { scene_.block.back().push_back(text); }
    void key(const char* name, double value) { line(std::string(name) + " = " + number(value)); }
    void key(const char* name, const Vec3d& value) { line(std::string(name) + " = " + vector(value)); }
    void key(const char* name, const char* value) { line(std::string(name) + " = \"" + value + "\""); }
    void flag(const char* name, double share) {
        if (dice_.chance(share)) line(std::string(name) + " = true");
    }
    void maybe(double share, const char* name, double low, double high) {
        const double value = dice_.log_uniform(low, high);
        if (dice_.chance(share)) key(name, value);
    }
    // The compiler chooses the order of calls within an expression: the dice are thrown in statements of their own.
    Vec3d direction(double low, double high) {
        const double length = low < high ? dice_.log_uniform(low, high) : low, z = dice_.uniform(-1, 1);
        const double turn = dice_.uniform(0, 2 * std::numbers::pi), r = std::sqrt(1 - z * z);
        return length * Vec3d(r * std::cos(turn), r * std::sin(turn), z);
    }
    Vec3d level(double low, double high) {
        const double radius = dice_.uniform(low, high), turn = dice_.uniform(0, 2 * std::numbers::pi);
        return {radius * std::cos(turn), radius * std::sin(turn), 0};
    }
    std::string rotation() {
        const Vec3d axis = direction(1, 1);
        const double degrees = dice_.uniform(0, 180);
        return "rotation = [" + number(axis.x()) + ", " + number(axis.y()) + ", " + number(axis.z()) + ", " + number(degrees) + "]";
    }
    std::string sometimes_turned(double share) { return dice_.chance(share) ? ", " + rotation() : ""; }

    void write_top() {
        line("seconds = 1.0");
        if (dice_.chance(0.3)) key("gravity", Vec3d(dice_.chance(0.5) ? Vec3d::Zero() : direction(1, 30)));
        maybe(0.15, "substep", 1e-4, 1e-2);
        if (dice_.chance(0.15)) key("sleep_speed", 0.0);
        line("[contact]");
        key("rate", 30.0 * static_cast<double>(1 + dice_.below(8)));
        if (dice_.chance(0.5)) key("iterations", static_cast<double>(1 + dice_.below(8)));
        maybe(0.4, "push_speed", 0.01, 4);
        maybe(0.15, "tolerance", 1e-6, 1e-3);
        if (dice_.chance(0.3)) key("share", dice_.pick({"stiffness", "half"}));
        if (dice_.chance(0.08)) key("direction", "thesis");
        if (dice_.chance(0.15)) key("deep", "last_free");
        if (dice_.chance(0.2)) key("search", "embree");
        flag("faces", 0.2), flag("contours", 0.1), flag("regions", 0.1);
    }

    void write_floor() {
        start_block();
        line("[[body]]");
        key("name", "floor");
        const bool box = dice_.chance(0.3);
        const double size = 0.5 * scale_;
        key("shape", box ? "box" : "table");
        key("triangles", std::floor(dice_.log_uniform(12, 800)));
        key("size", size);
        key("position", Vec3d(0, 0, -size * unit_box(box ? "box" : "table").max.z()));
        if (dice_.chance(0.2)) line("[body.haptic]"), maybe(1, "stiffness", 100, 1e4), maybe(0.5, "damping", 0.1, 10);
    }

    const char* pick_shape(bool closed) {
        const char* shape = dice_.pick(
            {"sphere", "sphere", "box", "box", "liver", "kidney", "gallbladder", "stomach", "bowel", "hernia_wall", "surgical_mesh"});
        return closed && shape == std::string("surgical_mesh") ? "sphere" : shape;
    }

    void write_body(size_t index) {
        start_block();
        line("[[body]]");
        const std::string name = "body" + std::to_string(index);
        key("name", name.c_str());
        const double kind = dice_.uniform(0, index == 0 ? 0.8 : 1);  // the first one moves
        const bool deformable = kind < 0.5, is_free = !deformable && kind < 0.8, scripted = !deformable && !is_free && kind < 0.92;
        const std::string shape = pick_shape(is_free);
        const bool sheet = shape == "surgical_mesh";
        const double size = scale_ * dice_.log_uniform(0.03, 0.12);
        key("shape", shape.c_str());
        key("triangles", std::floor(sheet || shape == "hernia_wall" ? 600 : dice_.log_uniform(200, 500)));
        key("size", size);
        if (dice_.chance(0.1)) key("seed", static_cast<double>(dice_.below(1000)));
        key("motion", deformable ? "deformable" : is_free ? "free" : scripted ? "kinematic" : "static");
        const Box box = unit_box(shape);
        Vec3d place = size * level(0, 0.3);
        place.z() = jumble_ ? dice_.uniform(0, 0.1) * scale_ : top_ + dice_.log_uniform(1e-4, 0.03) * scale_ - size * box.min.z();
        if (!jumble_) top_ = place.z() + size * box.max.z();
        if (scripted) {
            write_path(place);
        } else {
            key("position", place);
            // a turned box would reach its neighbours
            if (jumble_ || shape == "sphere") line(rotation());
        }
        bool solid = false, skin = false;
        if (deformable) write_deformable(shape, size, solid, skin);
        if (is_free && dice_.chance(0.3)) key("velocity", direction(0.01, 3));
        if (is_free && dice_.chance(0.3)) key("spin", direction(0.1, 30));
        if (is_free) maybe(0.2, "mass", wild_ ? 1e-6 : 1e-2, wild_ ? 1e6 : 1);
        if (sheet) maybe(0.4, "thickness", 1e-4, 5e-3);
        bool whole = false;
        if (deformable || is_free || dice_.chance(0.3)) whole = write_tissue(solid || is_free, sheet, index);
        if (deformable && dice_.chance(0.08)) {
            line("[[body.region]]");
            line("sphere = [0.0, 0.0, 0.0, " + number(0.45 * size) + "]");
            key("stiffness", dice_.log_uniform(wild_ ? 1e-6 : 0.1, wild_ ? 1e6 : 10));
        }
        placed_.push_back({name, size, place, deformable, !whole && !skin});
    }

    // Through the middle of what stands there, or past it.
    void write_path(const Vec3d& place) {
        const double speed = dice_.log_uniform(0.02, wild_ ? 5 : 1) * scale_, far = 0.35 * scale_;
        const Vec3d side = far * level(1, 1);
        const double above = dice_.uniform(0, 0.5), beyond = dice_.uniform(-1, 0.5);
        const Vec3d start = place + side + Vec3d(0, 0, above * far), end = place + beyond * side;
        const double seconds = std::clamp((end - start).norm() / speed, 0.02, 5.0);
        const std::string turned = sometimes_turned(0.3);
        line("path = [{time = 0.0, position = " + vector(start) + "}, {time = " + number(seconds) + ", position = " + vector(end) + turned +
             "}" + (dice_.chance(0.5) ? ", {time = " + number(2 * seconds) + ", position = " + vector(start) + "}" : "") + "]");
    }

    void write_deformable(const std::string& shape, double size, bool& solid, bool& skin) {
        const bool sheet = shape == "surgical_mesh", thin = sheet || shape == "bowel" || shape == "hernia_wall" || shape == "gallbladder";
        solid = !thin && dice_.chance(0.6);
        skin = !thin && dice_.chance(solid ? 0.3 : 0.1);
        if (solid) {
            key("model", "solid");
            key("cells", std::floor(dice_.uniform(4, 9)));
            flag("bed", 0.15);
        } else if (skin) {
            key("cells", std::floor(dice_.uniform(4, 6)));
        }
        if (skin) line("skin = true");
        if (dice_.chance(0.6)) key("anchor", "shape");
        if (dice_.chance(0.2)) key("fixed_below", -dice_.uniform(0.1, 0.4) * size);
        const double stepped = dice_.uniform(0, 1);
        if (stepped < 0.3 && !solid) key("integrator", "implicit");
        if (stepped > 0.8) key("integrator", "auto");
        if (stepped < 0.3) maybe(0.3, "step", 5e-4, 5e-3);
        if (stepped < 0.3 && dice_.chance(0.2)) key("iterations", std::floor(dice_.log_uniform(2, 100)));
        if (!skin) maybe(0.05, "break_strain", 0.05, 2);
    }

    // Returns whether a shell of it keeps its volume or bends.
    bool write_tissue(bool no_shell, bool sheet, size_t index) {
        line("[body.tissue]");
        if (wild_ == 0 && !sheet && dice_.chance(0.15)) {
            key("preset", dice_.pick({"liver", "kidney", "gallbladder", "bowel", "fat", "muscle"}));
            if (!no_shell) return true;
        }
        const bool wild = wild_ == 2 || (wild_ == 1 && index == 0);
        const auto number_of = [&](const char* name, double low, double high, double least, double most, double share = 1) {
            const bool beyond = wild && dice_.chance(0.5);
            maybe(share, name, beyond ? least : low, beyond ? most : high);
        };
        number_of("youngs_modulus", 1e3, 1e6, 1, 1e12);
        number_of("density", 900, 1200, 1e-3, 1e6, 0.6);
        number_of("wall", 1e-3, 1e-2, 1e-9, 1e3, 0.8);
        number_of("depth", 5e-3, 0.1, 1e-9, 1e9, 0.8);
        if (dice_.chance(0.7)) key("poisson", dice_.chance(0.2) ? 0.25 : dice_.uniform(0.25, wild ? 0.4998 : 0.49));
        number_of("damping", 0.1, 60, 1e-3, 1e6, 0.8);
        number_of("friction", 0.01, 1, 1e-3, 1e6, 0.7);
        if (dice_.chance(0.2)) key("restitution", dice_.uniform(0, 1));
        if (no_shell) return false;
        const bool swells = !sheet && dice_.chance(0.2), bends = dice_.chance(0.2);
        if (swells) number_of("pressure_modulus", 1e2, 1e5, 1e-3, 1e12);
        if (bends) number_of("bending", 1e2, 1e6, 1e-3, 1e12);
        return swells || bends;
    }

    void write_tool(size_t index) {
        const bool turns = dice_.chance(0.45);
        const std::string name = "tool" + std::to_string(index);
        const std::string shape = turns ? dice_.pick({"sphere", "box", "probe", "needle", "grasper"}) : dice_.pick({"sphere", "probe"});
        const double size = shape == "sphere" ? scale_ * dice_.log_uniform(2e-3, 0.04)
                            : shape == "box"  ? scale_ * dice_.log_uniform(0.01, 0.04)
                                              : 0;
        const Box box = unit_box(shape);
        // from the free height over everything down into what is there, along and out again
        const double reach = (size > 0 ? size : 0.17) * std::max(box.max.norm(), box.min.norm()), press = dice_.uniform(0, 0.04) * scale_;
        const double low = size > 0 ? -size * box.min.z() : 0.007;
        const Vec3d over = scale_ * level(0, 0.04) + 0.12 * static_cast<double>(index) * scale_ * Vec3d(1, 0, 0);
        const Vec3d start = over + Vec3d(0, 0, top_ + (size > 0 ? 2 * reach : 0.02) + 0.02 * scale_);
        const Vec3d down = over + Vec3d(0, 0, top_ + low - press), along = down + scale_ * level(0, 0.03);
        start_block();
        line("[[body]]");
        key("name", name.c_str());
        key("shape", shape.c_str());
        key("triangles", shape == "grasper" ? 1000 : shape == "probe" ? 300 : 200);
        if (size > 0) key("size", size);
        key("motion", "hand");
        maybe(0.3, "mass", 0.02, 0.3);
        key("position", start);
        line("[[tool]]");
        key("body", name.c_str());
        if (turns) line("dof = 6");
        if (!turns) key("tip_radius", shape == "sphere" ? 0.5 * size : 0.007);
        maybe(0.5, "stiffness", 50, wild_ == 2 ? 1e5 : 2000);
        maybe(0.3, "max_force", 1, 20);
        maybe(0.3, "friction", 0.01, 1);
        if (turns && dice_.chance(0.3)) key("points", std::floor(dice_.log_uniform(50, 1000)));
        maybe(0.05, "pass_through", 0.5, 3);
        const double into = dice_.log_uniform(0.05, 0.6);
        const std::string turned = turns ? sometimes_turned(0.4) : "";
        line("path = [{time = 0.0, position = " + vector(start) + "}, {time = " + number(into) + ", position = " + vector(down) +
             "}, {time = " + number(into + 0.2) + ", position = " + vector(along) + turned + "}, {time = " + number(into + 0.35) +
             ", position = " + vector(start) + "}]");
        if (dice_.chance(0.25)) {
            line("[tool.hand]");
            key("mass", dice_.log_uniform(0.1, 1));
            key("stiffness", dice_.log_uniform(100, 2000));
            key("arm_damping", dice_.log_uniform(1, 30));
            key("damping", dice_.log_uniform(2, 10));
            maybe(0.3, "encoder", 1e-6, 1e-4);
            if (dice_.chance(0.3)) key("delay", static_cast<double>(1 + dice_.below(3)));
        }
    }

    void write_attachments() {
        for (const Placed& body : placed_) {
            if (!body.deformable) continue;
            const Placed& other = placed_[dice_.below(placed_.size())];
            const double choice = dice_.uniform(0, 1);
            if (choice < 0.08 && other.name != body.name) {
                start_block();
                line("[[link]]");
                key("body", body.name.c_str()), key("to", other.name.c_str());
                key("within", dice_.uniform(0.1, 0.4) * body.size);
                maybe(0.3, "stiffness", 1, 1000), maybe(0.3, "break_strain", 0.1, 3);
            } else if (choice > 0.94 && body.may_be_cut) {
                start_block();
                line("[[cut]]");
                key("body", body.name.c_str());
                line("sphere = [0.0, 0.0, " + number(0.3 * body.size) + ", " + number(0.3 * body.size) + "]");
                key("time", dice_.uniform(0, 0.6));
            }
        }
    }

    Dice dice_;
    RandomScene scene_;
    std::vector<Placed> placed_;
    int wild_ = 0;         // materials: 0 = usual, 1 = those of the first body range over all that is admitted, 2 = all
    double scale_ = 1;     // of the whole scene
    double top_ = 0;       // m, height up to which there are bodies
    bool jumble_ = false;  // bodies start inside each other
};

}  // namespace

std::string RandomScene::text() const {
    std::string all;
    for (const auto& lines : block) {
        for (const std::string& line : lines) all += line + "\n";
        all += "\n";
    }
    return all;
}

RandomScene random_scene(uint64_t seed) { return Writer(seed).write(); }

}  // namespace trocar::fuzz
