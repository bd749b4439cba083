#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "engine/devices/device.hpp"
#include "engine/devices/link.hpp"
#include "engine/jobs/real_time.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/report/figures.hpp"
#include "systems/haptics/safety.hpp"
namespace trocar {
namespace {

using nlohmann::ordered_json;

// What a 1 kHz loop measured on a device.
struct DeviceFigures {
    std::vector<DeviceState> sample;  // arrival times relative to the first
    std::vector<double> gap_ms;       // between samples
    Box box;                          // m, bounds of the positions
    double fastest = 0;               // m/s
    double largest_force = 0;         // N
    uint32_t buttons = 0;             // bits of all buttons pressed at least once
    PeriodicFigures timing;
    DeviceCounts counts{};
};

// Reads the device every millisecond, as a live run does; a spring, if set, pulls towards the first position.
DeviceFigures listen(DeviceLink& link, const DeviceOptions& options) {
    DeviceFigures figures;
    figures.sample.reserve(static_cast<size_t>(options.seconds * 1100) + 100);
    figures.gap_ms.reserve(figures.sample.capacity());
    int64_t last = 0, first = 0;
    SafetyState safety;
    DeviceCommand output;
    const DeviceLimits limits;
    PeriodicThread thread;
    thread.start({}, monotonic_ns(), [&](uint64_t, int64_t now) {
        const LinkSample& newest = link.read();
        if (newest.received_ns == 0) return;
        const bool stale = now - newest.received_ns > 8'000'000;
        if (newest.received_ns != last && figures.sample.size() < figures.sample.capacity()) {
            if (first == 0)
                first = newest.received_ns;
            else
                figures.gap_ms.push_back(static_cast<double>(newest.received_ns - last) * 1e-6);
            last = newest.received_ns;
            DeviceState state = newest.state;
            state.time = static_cast<double>(last - first) * 1e-9;
            figures.sample.push_back(state);
        }
        DeviceCommand wanted;
        wanted.at = newest.state.position;
        wanted.force = options.spring * (figures.sample.front().position - newest.state.position);
        limit_command(limits, options.max_force, 1e-3, stale || options.spring == 0, wanted, safety, output);
        figures.largest_force = std::max(figures.largest_force, output.force.norm());
        link.write(output, now);
    });
    sleep_until_ns(monotonic_ns() + static_cast<int64_t>(options.seconds * 1e9));
    thread.stop();
    link.let_go();
    figures.timing = thread.figures();
    figures.counts = link.counts();
    for (const DeviceState& s : figures.sample) {
        grow(figures.box, s.position);
        figures.fastest = std::max(figures.fastest, s.velocity.norm());
        figures.buttons |= s.buttons;
    }
    return figures;
}

ordered_json to_json(const DeviceLink& link, const DeviceOptions& options, const DeviceFigures& f) {
    ordered_json counts;
    for (size_t k = 0; k < f.counts.size(); ++k) counts[describe(static_cast<DeviceCount>(k))] = f.counts[k];
    const Vec3d extent = f.sample.empty() ? Vec3d(Vec3d::Zero()) : Vec3d(f.box.max - f.box.min);
    return {{"device", link.name()},
            {"seconds", options.seconds},
            {"samples", f.sample.size()},
            {"rate_hz", static_cast<double>(f.sample.size()) / options.seconds},
            {"gap_ms", {{"p50", quantile(f.gap_ms, 0.5)}, {"p99", quantile(f.gap_ms, 0.99)}, {"max", quantile(f.gap_ms, 1)}}},
            {"extent_m", {extent.x(), extent.y(), extent.z()}},
            {"fastest_m_s", f.fastest},
            {"largest_force_n", f.largest_force},
            {"buttons", f.buttons},
            {"tick",
             {{"period_p99_us", static_cast<double>(f.timing.period.percentile(0.99)) * 1e-3},
              {"missed", f.timing.missed},
              {"scheduling", describe(f.timing.grant)}}},
            {"counts", counts}};
}

std::string to_text(const ordered_json& j) {
    std::string all = format(
        "%s: %llu samples in %g s, %.0f per second; intervals %.2f ms (p50), %.2f (p99), %.2f (longest)\n"
        "  moved through %.1f x %.1f x %.1f mm, fastest %.3f m/s, buttons %#x, largest force %.2f N\n"
        "  our tick: period p99 %.0f us, %llu missed, %s\n ",
        j["device"].get<std::string>().c_str(), j["samples"].get<unsigned long long>(), j["seconds"].get<double>(),
        j["rate_hz"].get<double>(), j["gap_ms"]["p50"].get<double>(), j["gap_ms"]["p99"].get<double>(), j["gap_ms"]["max"].get<double>(),
        j["extent_m"][0].get<double>() * 1e3, j["extent_m"][1].get<double>() * 1e3, j["extent_m"][2].get<double>() * 1e3,
        j["fastest_m_s"].get<double>(), j["buttons"].get<unsigned>(), j["largest_force_n"].get<double>(),
        j["tick"]["period_p99_us"].get<double>(), j["tick"]["missed"].get<unsigned long long>(),
        j["tick"]["scheduling"].get<std::string>().c_str());
    for (const auto& [name, number] : j["counts"].items())
        if (number.get<uint64_t>() > 0) all += " " + name + " " + std::to_string(number.get<uint64_t>());
    return all + "\n";
}

}  // namespace

void close_devices(std::span<DeviceLink* const> links) {
    DeviceLink::close_all(links);
    for (DeviceLink* link : links)
        if (!link->close()) std::fprintf(stderr, "trocar: %s does not respond; it is not closed\n", link->name().c_str());
}

int device_list_command(bool json) {
    ordered_json rows = ordered_json::array();
    std::string text;
    for (const DeviceBackend& backend : device_backends()) {
        rows.push_back({{"name", backend.name}, {"usage", backend.usage}, {"description", backend.description}, {"built", backend.built}});
        text += format("%-24s %s%s\n", backend.usage.c_str(), backend.description.c_str(),
                       backend.built ? "" : " - not in this build: its library was not found");
    }
    write_standard_output(json ? rows.dump(1) + "\n" : text + "\nTry one: trocar device test hand --seconds 2 --spring 100\n");
    return kDone;
}

int device_test_command(const DeviceOptions& options) {
    const std::unique_ptr<DeviceLink> link = open_device(options.device);
    const DeviceFigures figures = listen(*link, options);
    const ordered_json j = to_json(*link, options, figures);
    write_standard_output(options.json ? j.dump(1) + "\n" : to_text(j));
    if (figures.sample.empty()) std::fprintf(stderr, "trocar: %s sent no usable sample\n", link->name().c_str());
    close_devices(std::array{link.get()});
    return figures.sample.empty() ? kNo : kDone;
}

int device_record_command(const DeviceOptions& options) {
    DeviceOptions silent = options;
    silent.spring = 0;
    const std::unique_ptr<DeviceLink> link = open_device(options.device);
    const DeviceFigures figures = listen(*link, silent);
    close_devices(std::array{link.get()});
    if (figures.sample.empty()) {
        std::fprintf(stderr, "trocar: %s sent no usable sample; nothing was written\n", link->name().c_str());
        return kNo;
    }
    write_device_trace(options.out, figures.sample);
    write_standard_output(
        format("wrote %s: %zu samples, %.3f s\n", options.out.string().c_str(), figures.sample.size(), figures.sample.back().time));
    return kDone;
}

}  // namespace trocar
