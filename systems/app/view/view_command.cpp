#include "systems/app/view/view_command.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "engine/base/error.hpp"
namespace trocar {
namespace {

constexpr std::array<const char*, 6> kCommandWords{"set", "grab", "pull", "let", "bleed", "slip"};
constexpr size_t kLongestKey = 200;        // characters, of a key or a value
constexpr double kFarthestCommand = 1e6;   // m, of a coordinate
constexpr double kFastestBleeding = 1e-4;  // m^3/s: more than a heart gives, 5 l/min

bool has_body(ViewCommand::Kind kind) { return kind == ViewCommand::Kind::kGrab || kind == ViewCommand::Kind::kBleed; }
bool has_point(ViewCommand::Kind kind) { return kind != ViewCommand::Kind::kSet && kind != ViewCommand::Kind::kLet; }

const nlohmann::json& member(const nlohmann::json& object, const char* key) {
    const auto found = object.find(key);
    if (found == object.end()) throw InputError(std::string("a command without \"") + key + "\"");
    return *found;
}

std::string text_in(const nlohmann::json& object, const char* key) {
    const nlohmann::json& value = member(object, key);
    if (!value.is_string() || value.get_ref<const std::string&>().size() > kLongestKey)
        throw InputError(std::string("a command whose \"") + key + "\" is no short text");
    return value.get<std::string>();
}

uint64_t count_in(const nlohmann::json& object, const char* key, uint64_t most) {
    const nlohmann::json& value = member(object, key);
    if (!value.is_number_unsigned() || value.get<uint64_t>() > most)
        throw InputError(std::string("a command whose \"") + key + "\" is no whole number in range");
    return value.get<uint64_t>();
}

Vec3d point_in(const nlohmann::json& object, const char* key) {
    const nlohmann::json& value = member(object, key);
    Vec3d point;
    bool good = value.is_array() && value.size() == 3;
    for (size_t k = 0; good && k < 3; ++k) {
        good = value[k].is_number();
        if (good) point[static_cast<int>(k)] = value[k].get<double>();
        good = good && std::abs(point[static_cast<int>(k)]) <= kFarthestCommand;  // false for what is no number
    }
    if (!good) throw InputError(std::string("a command whose \"") + key + "\" is not three numbers");
    return point;
}

}  // namespace

std::string text_of(const ViewCommand& c) {
    nlohmann::json text{{"pass", c.pass}, {"do", kCommandWords[static_cast<size_t>(c.kind)]}};
    if (c.kind == ViewCommand::Kind::kSet) text["key"] = c.key, text["value"] = c.value;
    if (has_body(c.kind)) text["body"] = c.body;
    if (c.kind == ViewCommand::Kind::kBleed) text["rate"] = c.rate;
    if (has_point(c.kind)) text["point"] = {c.point.x(), c.point.y(), c.point.z()};
    return text.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

ViewCommand read_view_command(const std::string& text) {
    const nlohmann::json object = nlohmann::json::parse(text, nullptr, false);
    if (!object.is_object()) throw InputError("a command that is no JSON object");
    const std::string word = text_in(object, "do");
    ViewCommand c;
    const auto at = std::find(kCommandWords.begin(), kCommandWords.end(), word);
    if (at == kCommandWords.end()) throw InputError("a command \"" + word + "\"");
    c.kind = static_cast<ViewCommand::Kind>(at - kCommandWords.begin());
    if (object.contains("pass")) c.pass = count_in(object, "pass", uint64_t{1} << 53);
    if (c.kind == ViewCommand::Kind::kSet) c.key = text_in(object, "key"), c.value = text_in(object, "value");
    if (has_body(c.kind)) c.body = static_cast<uint32_t>(count_in(object, "body", 0xfffffffeu));
    if (has_point(c.kind)) c.point = point_in(object, "point");
    if (c.kind == ViewCommand::Kind::kBleed) {
        const nlohmann::json& rate = member(object, "rate");
        c.rate = rate.is_number() ? rate.get<double>() : 0;
        if (!(c.rate > 0 && c.rate <= kFastestBleeding)) throw InputError("a command whose \"rate\" is no flow of blood in m^3/s");
    }
    return c;
}

}  // namespace trocar
