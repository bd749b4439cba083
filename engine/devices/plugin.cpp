#include <dlfcn.h>

#include <cmath>
#include <cstring>
#include <filesystem>

#include "components/trocar_device.h"
#include "engine/devices/backends.hpp"
#include "engine/devices/packets.hpp"
#include "engine/jobs/real_time.hpp"
namespace trocar {
namespace {

constexpr int64_t kPeriod = 1'000'000, kRetry = 500'000'000;  // ns

struct Library {
    void* handle = nullptr;
    const trocar_device_api* api = nullptr;
    std::string options;
    void* device = nullptr;
    ~Library() {
        if (device) api->close(device);
        if (handle) ::dlclose(handle);
    }
    // Returns the reason of a failure.
    std::string open() {
        char reason[256] = "";
        device = api->open(options.c_str(), reason, sizeof reason);
        reason[sizeof reason - 1] = 0;
        return device ? "" : reason[0] ? reason : "the plug-in gives no reason";
    }
};

trocar_device_command to_plain(const DeviceCommand& c) {
    trocar_device_command plain{};
    for (int k = 0; k < 3; ++k) plain.force[k] = c.force[k], plain.torque[k] = c.torque[k], plain.at[k] = c.at[k];
    for (size_t k = 0; k < 9; ++k) plain.stiffness[k] = c.stiffness[k];
    return plain;
}

DeviceState to_state(const trocar_device_state& plain) {
    DeviceState state;
    state.time = plain.time;
    state.position = {plain.position[0], plain.position[1], plain.position[2]};
    state.orientation = {plain.orientation[0], plain.orientation[1], plain.orientation[2], plain.orientation[3]};
    state.velocity = {plain.velocity[0], plain.velocity[1], plain.velocity[2]};
    state.grip = plain.grip;
    state.buttons = plain.buttons;
    return state;
}

void exchange(DeviceChannel& link, Library& library) {
    bool fresh = false;
    const trocar_device_command command = to_plain(link.command(monotonic_ns(), fresh));
    trocar_device_state plain{};
    plain.orientation[0] = 1;
    const trocar_exchange answer = library.api->exchange(library.device, &command, &plain);
    if (fresh) link.count(DeviceCount::kSent);
    if (answer == TROCAR_NONE) return;
    if (answer != TROCAR_NEW) {
        library.api->close(library.device);
        library.device = nullptr;
        return;
    }
    link.count(DeviceCount::kReceived);
    DeviceState state = to_state(plain);
    if (is_sound(state))
        link.publish(state, monotonic_ns());
    else
        link.count(DeviceCount::kMalformed);
}

// Waits half a second, or until the link stops.
void wait_for_retry(const DeviceChannel& link) {
    const int64_t end = monotonic_ns() + kRetry;
    while (!link.stopping() && monotonic_ns() < end) sleep_until_ns(monotonic_ns() + 10 * kPeriod);
}

void serve(DeviceChannel& link, Library& library) {
    request_real_time(79, false);
    int64_t due = monotonic_ns();
    while (!link.stopping()) {
        sleep_until_ns(due);
        if (library.device) {
            exchange(link, library);
            due = std::max(due + kPeriod, monotonic_ns());
            continue;
        }
        wait_for_retry(link);
        if (!link.stopping() && library.open().empty()) link.count(DeviceCount::kReconnected);
        due = monotonic_ns();
    }
}

}  // namespace

std::unique_ptr<DeviceLink> open_plugin_device(const std::string& specification, const std::string& rest) {
    const size_t question = rest.find('?');
    const std::string file = rest.substr(0, question);
    if (file.empty()) refuse_device(specification, "write plugin:FILE or plugin:FILE?OPTIONS");
    auto library = std::make_shared<Library>();
    if (question != std::string::npos) library->options = rest.substr(question + 1);
    // a bare name would be searched in the system's folders only
    library->handle = ::dlopen(std::filesystem::absolute(file).c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!library->handle) refuse_device(specification, ::dlerror());
    const auto entry = reinterpret_cast<const trocar_device_api* (*)()>(::dlsym(library->handle, "trocar_device"));
    if (!entry) refuse_device(specification, "the library has no function trocar_device");
    library->api = entry();
    const trocar_device_api* api = library->api;
    if (!api || api->version != TROCAR_DEVICE_VERSION)
        refuse_device(specification, "made for version " + std::to_string(api ? api->version : 0) +
                                         " of trocar_device.h; this program has version " + std::to_string(TROCAR_DEVICE_VERSION));
    if (!api->open || !api->exchange || !api->close) refuse_device(specification, "open, exchange or close is missing");
    const std::string reason = library->open();
    if (!reason.empty()) refuse_device(specification, reason);
    return std::make_unique<DeviceLink>("plug-in " + std::string(api->name ? api->name : file),
                                        [library](DeviceChannel& link) { serve(link, *library); });
}

}  // namespace trocar
