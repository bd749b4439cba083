#include <cstdio>
#include <cstring>

#include "engine/devices/backends.hpp"
#include "engine/devices/packets.hpp"
#include "engine/jobs/real_time.hpp"
#ifdef TROCAR_HAPLY
#include <libwebsockets.h>

#include <nlohmann/json.hpp>
#endif
namespace trocar {

#ifndef TROCAR_HAPLY

bool haply_is_built() { return false; }
bool read_haply_message(std::string_view, std::string&, DeviceState&) { return false; }
std::string haply_command(const std::string&, const Vec3d&) { return ""; }
std::unique_ptr<DeviceLink> open_haply_device(const std::string& specification, const NetworkAddress&) {
    refuse_device(specification, "this program was built without libwebsockets");
}

#else

namespace {

using nlohmann::json;

constexpr size_t kLongest = 64 * 1024;   // bytes of a message
constexpr int64_t kRetry = 500'000'000;  // ns between attempts to connect
constexpr lws_usec_t kLook = 20'000;     // us between checks whether to stop
constexpr size_t kLongestId = 128;

// The member of an object; null if there is none.
const json* member(const json* parent, const char* key) {
    if (!parent || !parent->is_object()) return nullptr;
    const auto found = parent->find(key);
    return found == parent->end() ? nullptr : &*found;
}
const json* first_of(const json* list) { return list && list->is_array() && !list->empty() ? &list->front() : nullptr; }

bool read_number(const json* parent, const char* key, double& value) {
    const json* number = member(parent, key);
    if (!number || !number->is_number()) return false;
    value = number->get<double>();
    return true;
}
bool read_vector(const json* parent, Vec3d& v) {
    return read_number(parent, "x", v.x()) && read_number(parent, "y", v.y()) && read_number(parent, "z", v.z());
}

// Orientation and buttons of the grip, of either kind.
void read_grip(const json& message, DeviceState& state) {
    for (const char* kind : {"wireless_verse_grip", "verse_grip", "custom_verse_grip"}) {
        const json* grip = member(first_of(member(&message, kind)), "state");
        if (!grip) continue;
        const json* turn = member(grip, "orientation");
        Quat q;
        if (read_number(turn, "w", q.w) && read_number(turn, "x", q.x) && read_number(turn, "y", q.y) && read_number(turn, "z", q.z))
            state.orientation = q;
        const json* buttons = member(grip, "buttons");
        constexpr const char* kNames[] = {"a", "b", "c"};
        for (uint32_t k = 0; k < 3; ++k) {
            const json* pressed = member(buttons, kNames[k]);
            if (pressed && pressed->is_boolean() && pressed->get<bool>()) state.buttons |= 1u << k;
        }
        return;
    }
}

// One connection to the service, used by the callbacks of libwebsockets.
struct Talk {
    DeviceChannel& link;
    lws* socket = nullptr;
    std::string text = "";  // of the incoming message
    bool too_long = false;
    std::string device_id = "";
    bool was_connected = false;
    lws_sorted_usec_list_t look{};
};

void take_message(Talk& talk) {
    talk.link.count(DeviceCount::kReceived);
    DeviceState state;
    if (talk.too_long) {
        talk.link.count(DeviceCount::kOversized);
    } else if (read_haply_message(talk.text, talk.device_id, state)) {
        const int64_t now = monotonic_ns();
        state.time = static_cast<double>(now) * 1e-9;
        talk.link.publish(state, now);
    } else {
        talk.link.count(DeviceCount::kMalformed);
    }
    talk.text.clear();
    talk.too_long = false;
}

void send_command(Talk& talk) {
    if (talk.device_id.empty()) return;
    bool fresh = false;
    const DeviceCommand command = talk.link.command(monotonic_ns(), fresh);
    const std::string text = haply_command(talk.device_id, command.force);
    std::string bytes(LWS_PRE, '\0');
    bytes += text;
    const int sent = lws_write(talk.socket, reinterpret_cast<unsigned char*>(bytes.data()) + LWS_PRE, text.size(), LWS_WRITE_TEXT);
    if (sent == static_cast<int>(text.size())) talk.link.count(DeviceCount::kSent);
}

int on_event(lws* socket, lws_callback_reasons reason, void*, void* in, size_t size) {
    if (reason != LWS_CALLBACK_CLIENT_ESTABLISHED && reason != LWS_CALLBACK_CLIENT_RECEIVE && reason != LWS_CALLBACK_CLIENT_WRITEABLE &&
        reason != LWS_CALLBACK_CLIENT_CLOSED && reason != LWS_CALLBACK_CLIENT_CONNECTION_ERROR)
        return 0;
    Talk& talk = *static_cast<Talk*>(lws_context_user(lws_get_context(socket)));
    switch (reason) {
        case LWS_CALLBACK_CLIENT_ESTABLISHED:
            if (talk.was_connected) talk.link.count(DeviceCount::kReconnected);
            talk.was_connected = true;
            break;
        case LWS_CALLBACK_CLIENT_RECEIVE:
            if (talk.text.size() + size > kLongest) talk.too_long = true;
            if (!talk.too_long) talk.text.append(static_cast<const char*>(in), size);
            if (!lws_is_final_fragment(socket) || lws_remaining_packet_payload(socket) > 0) break;
            take_message(talk);
            lws_callback_on_writable(socket);  // one state per command: the answer triggers the next request
            break;
        case LWS_CALLBACK_CLIENT_WRITEABLE:
            send_command(talk);
            break;
        default:
            talk.socket = nullptr;  // closed, or never was
    }
    return 0;
}

// Only ends the wait for events.
void look_again(lws_sorted_usec_list_t*) {}

void connect(lws_context* context, const NetworkAddress& address, Talk& talk) {
    talk.text.clear();
    talk.device_id.clear();
    talk.too_long = false;
    lws_client_connect_info info{};
    info.context = context;
    info.address = info.host = info.origin = address.host.c_str();
    info.port = address.port;
    info.path = "/";
    info.local_protocol_name = "haply";
    info.pwsi = &talk.socket;
    lws_client_connect_via_info(&info);
}

void serve(DeviceChannel& link, const NetworkAddress& address) {
    lws_set_log_level(0, nullptr);
    Talk talk{link};
    const lws_protocols protocols[] = {{"haply", on_event, 0, 4096, 0, nullptr, 0}, {nullptr, nullptr, 0, 0, 0, nullptr, 0}};
    lws_context_creation_info info{};
    info.port = CONTEXT_PORT_NO_LISTEN;
    info.protocols = protocols;
    info.http_proxy_address = "";  // never through a proxy
    info.gid = info.uid = static_cast<decltype(info.uid)>(-1);
    info.user = &talk;
    lws_context* const context = lws_create_context(&info);
    if (!context) return;
    int64_t next_try = 0;
    while (!link.stopping()) {
        if (!talk.socket && monotonic_ns() >= next_try) {
            next_try = monotonic_ns() + kRetry;
            connect(context, address, talk);
        }
        lws_sul_schedule(context, 0, &talk.look, look_again, kLook);
        if (lws_service(context, 0) < 0) break;
    }
    lws_sul_schedule(context, 0, &talk.look, look_again, LWS_SET_TIMER_USEC_CANCEL);
    lws_context_destroy(context);
}

}  // namespace

bool haply_is_built() { return true; }

bool read_haply_message(std::string_view text, std::string& device_id, DeviceState& state) {
    const json message = json::parse(text, nullptr, false);
    if (message.is_discarded()) return false;
    const json* device = first_of(member(&message, "inverse3"));
    const json* id = member(device, "device_id");
    const json* cursor = member(device, "state");
    if (!id || !id->is_string() || !cursor) return false;
    const std::string& name = id->get_ref<const std::string&>();
    if (name.empty() || name.size() > kLongestId) return false;
    DeviceState found;
    if (!read_vector(member(cursor, "cursor_position"), found.position)) return false;
    if (!read_vector(member(cursor, "cursor_velocity"), found.velocity)) return false;
    read_grip(message, found);
    if (!is_sound(found)) return false;
    device_id = name;
    state = found;
    return true;
}

std::string haply_command(const std::string& device_id, const Vec3d& force) {
    const json vector = {{"x", force.x()}, {"y", force.y()}, {"z", force.z()}};
    const json command = {{"device_id", device_id}, {"commands", {{"set_cursor_force", {{"vector", vector}}}}}};
    return json{{"inverse3", json::array({command})}}.dump(-1, ' ', true, json::error_handler_t::replace);
}

std::unique_ptr<DeviceLink> open_haply_device(const std::string&, const NetworkAddress& address) {
    return std::make_unique<DeviceLink>("Haply service at " + address.host + ":" + std::to_string(address.port),
                                        [address](DeviceChannel& link) { serve(link, address); });
}

#endif

}  // namespace trocar
