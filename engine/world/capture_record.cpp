#include "engine/world/capture_record.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <sstream>

#include "components/fields.hpp"
#include "engine/base/error.hpp"
#include "engine/base/key_of.hpp"
namespace trocar {
namespace {

template <typename Visit>
void each_resource(ResourceKind kind, const Visit& visit) {
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
        if (resource_kind(static_cast<Resource>(r)) == kind) visit(static_cast<Resource>(r));
}

void add_value(CaptureRecord& record, const std::string& name, bool value) { add_value(record, name, uint64_t{value}); }
void read_value(const CaptureRecord& record, const std::string& name, bool& value) {
    uint64_t number = 0;
    read_value(record, name, number);
    value = number != 0;
}

// One name a line.
void add_value(CaptureRecord& record, const std::string& name, const std::vector<std::string>& names) {
    std::string text;
    for (const std::string& one : names) text += one + "\n";
    add_value(record, name, text);
}
void read_value(const CaptureRecord& record, const std::string& name, std::vector<std::string>& names) {
    std::string text;
    read_value(record, name, text);
    std::istringstream lines(text);
    for (std::string one; std::getline(lines, one);) names.push_back(one);
}

// A camera's numbers but its kind, in the order of the file.
template <typename AnyCamera>
auto numbers_of(AnyCamera& c) {
    return std::array{&c.target.x(), &c.target.y(),   &c.target.z(),   &c.azimuth,      &c.elevation,
                      &c.distance,   &c.position.x(), &c.position.y(), &c.position.z(), &c.field_of_view};
}
// Those of a laparoscope, in an array of its own that other cameras do not have.
template <typename AnyCamera>
auto optics_of(AnyCamera& c) {
    return std::array{&c.lamp,     &c.shaft.x(), &c.shaft.y(), &c.shaft.z(),  &c.mark.x(), &c.mark.y(),
                      &c.mark.z(), &c.optic,     &c.optic_roll, &c.roll, &c.light};
}
void add_numbers(CaptureRecord& record, const std::string& name, const std::vector<double>& numbers) {
    add_value(record, name, numbers);
    record.arrays.back().rows = 1, record.arrays.back().columns = static_cast<uint32_t>(numbers.size());
}
void add_value(CaptureRecord& record, const std::string& name, const Camera& camera) {
    std::vector<double> numbers{static_cast<double>(camera.kind)};
    for (const double* number : numbers_of(camera)) numbers.push_back(*number);
    add_numbers(record, name, numbers);
    if (camera.kind != CameraKind::kLaparoscope) return;
    std::vector<double> optics{static_cast<double>(camera.body), camera.level ? 1.0 : 0.0};
    for (const double* number : optics_of(camera)) optics.push_back(*number);
    add_numbers(record, name + " optics", optics);
}
// The numbers of an array of one row.
std::vector<double> row_of(const CaptureRecord& record, const std::string& name, size_t columns) {
    const CaptureArray& a = find_array(record, name, ArrayType::kF64, static_cast<uint32_t>(columns));
    if (a.rows != 1) throw InputError("record header: " + name + " is not one");
    std::vector<double> numbers(columns);
    std::memcpy(numbers.data(), a.bytes.data(), columns * sizeof(double));
    return numbers;
}
void read_value(const CaptureRecord& record, const std::string& name, Camera& camera) {
    const auto numbers = numbers_of(camera);
    const std::vector<double> stored = row_of(record, name, 1 + numbers.size());
    camera.kind = stored[0] == 1 ? CameraKind::kLaparoscope : CameraKind::kOrbit;
    for (size_t k = 0; k < numbers.size(); ++k) *numbers[k] = stored[1 + k];
    const bool has_optics = std::any_of(record.arrays.begin(), record.arrays.end(), [&](const auto& a) { return a.name == name + " optics"; });
    if (!has_optics) return;
    const auto optics = optics_of(camera);
    const std::vector<double> more = row_of(record, name + " optics", 2 + optics.size());
    // whatever is no index of a body of the picture is none: see placed_camera
    camera.body = more[0] >= 0 && more[0] < static_cast<double>(kNone) ? static_cast<uint32_t>(more[0]) : kNone;
    camera.level = more[1] != 0;
    for (size_t k = 0; k < optics.size(); ++k) *optics[k] = more[2 + k];
}

template <typename T>
CaptureRecord make_record(const char* kind, const T& fields) {
    static_assert(lists_every_member<T>());
    CaptureRecord record{kind, {}};
    each_field(fields, [&](const FieldName& field, const auto& value) { add_value(record, key_of(field.name, field.unit), value); });
    return record;
}
template <typename T>
T read_fields(const CaptureRecord& record) {
    T fields;
    each_field(fields, [&](const FieldName& field, auto& value) { read_value(record, key_of(field.name, field.unit), value); });
    return fields;
}

}  // namespace

void save_resources(const World& world, ResourceKind kind, CaptureRecord& record) {
    each_resource(kind, [&](Resource r) { save_resource(world, r, record); });
}
void load_resources(const CaptureRecord& record, ResourceKind kind, World& world) {
    each_resource(kind, [&](Resource r) { load_resource(record, r, world); });
}

CaptureRecord to_record(const CaptureStep& step) {
    CaptureRecord r = make_record("step", step);
    r.arrays.insert(r.arrays.end(), step.input.begin(), step.input.end());
    return r;
}

CaptureStep read_step(const CaptureRecord& r) {
    CaptureStep step = read_fields<CaptureStep>(r);
    for (const CaptureArray& a : r.arrays)
        if (a.name.starts_with("haptics.")) step.input.push_back(a);
    return step;
}

CaptureHeader read_header(const CaptureRecord& record) { return read_fields<CaptureHeader>(record); }

CaptureRecord to_record(const CaptureHeader& header) { return make_record("header", header); }

void save_state(const World& world, CaptureRecord& record) {
    record.kind = "state";
    CaptureRecord number;
    add_value(number, "pass", world.clock.pass);
    if (record.arrays.empty()) record.arrays.emplace_back();
    record.arrays.front() = std::move(number.arrays.front());
    size_t at = 1;
    for (const ResourceKind kind : {ResourceKind::kState, ResourceKind::kAccounts})
        each_resource(kind, [&](Resource r) { at = save_resource(world, r, record, at); });
    record.arrays.resize(at);
}

}  // namespace trocar
