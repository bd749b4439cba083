#include "engine/world/capture_record.hpp"

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
void add_value(CaptureRecord& record, const std::string& name, const Camera& camera) {
    std::vector<double> numbers{static_cast<double>(camera.kind)};
    for (const double* number : numbers_of(camera)) numbers.push_back(*number);
    add_value(record, name, numbers);
    record.arrays.back().rows = 1, record.arrays.back().columns = static_cast<uint32_t>(numbers.size());
}
void read_value(const CaptureRecord& record, const std::string& name, Camera& camera) {
    const auto numbers = numbers_of(camera);
    const CaptureArray& a = find_array(record, name, ArrayType::kF64, 1 + static_cast<uint32_t>(numbers.size()));
    if (a.rows != 1) throw InputError("record header: camera is not one");
    double kind = 0;
    std::memcpy(&kind, a.bytes.data(), sizeof kind);
    camera.kind = kind == 1 ? CameraKind::kLaparoscope : CameraKind::kOrbit;
    for (size_t k = 0; k < numbers.size(); ++k) std::memcpy(numbers[k], a.bytes.data() + (1 + k) * sizeof(double), sizeof(double));
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
