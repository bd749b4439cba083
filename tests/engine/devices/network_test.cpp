#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "engine/devices/backends.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/real_time.hpp"
#include "mutate/mutants.hpp"
#include "tests/reference/device_waits.hpp"
#ifdef TROCAR_HAPLY
#include <libwebsockets.h>
#endif
#ifdef TROCAR_IGTL
#include <igtlPositionMessage.h>
#include <igtlSensorMessage.h>
#include <igtlServerSocket.h>
#include <igtlStatusMessage.h>
#include <igtlTransformMessage.h>
#endif

namespace trocar {
namespace {

[[maybe_unused]] uint16_t free_tcp_port() {
    const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    EXPECT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&address), size), 0);
    ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
    ::close(fd);
    return ntohs(address.sin_port);
}

// ---- Haply ----
#ifdef TROCAR_HAPLY

// As the service writes them: one Inverse3, its grip, and fields that we do not use.
std::string haply_state(double x, bool pressed) {
    using nlohmann::json;
    const json position = {{"x", x}, {"y", -0.02}, {"z", 0.03}}, velocity = {{"x", 0.1}, {"y", 0}, {"z", -0.2}};
    const json turn = {{"x", 0.0}, {"y", 0.6}, {"z", 0.0}, {"w", 0.8}};
    return json{{"inverse3",
                 {{{"device_id", "049D"},
                   {"status", {{"calibrated", true}}},
                   {"state", {{"cursor_position", position}, {"cursor_velocity", velocity}, {"current_cursor_force", velocity}}}}}},
                {"wireless_verse_grip",
                 {{{"device_id", "61548"}, {"state", {{"orientation", turn}, {"buttons", {{"a", false}, {"b", pressed}, {"c", true}}}}}}}}}
        .dump();
}

TEST(DeviceHaply, ReadsWhatTheServiceSays) {
    std::string id;
    DeviceState state;
    ASSERT_TRUE(read_haply_message(haply_state(0.01, true), id, state));
    EXPECT_EQ(id, "049D");
    EXPECT_EQ(state.position, Vec3d(0.01, -0.02, 0.03));
    EXPECT_EQ(state.velocity, Vec3d(0.1, 0, -0.2));
    EXPECT_NEAR(state.orientation.w, 0.8, 1e-15);
    EXPECT_NEAR(state.orientation.y, 0.6, 1e-15);
    EXPECT_EQ(state.buttons, 6u);
    // without a grip it is upright
    ASSERT_TRUE(read_haply_message(
        R"({"inverse3":[{"device_id":"a","state":{"cursor_position":{"x":1,"y":2,"z":3},"cursor_velocity":{"x":0,"y":0,"z":0}}}]})", id,
        state));
    EXPECT_EQ(state.orientation.w, 1);
    EXPECT_EQ(state.buttons, 0u);
    const std::string before = id;
    for (const char* bad :
         {"", "[]", "null", "{", "{\"inverse3\":{}}", "{\"inverse3\":[]}", "{\"inverse3\":[3]}", R"({"inverse3":[{"device_id":"b"}]})",
          R"({"inverse3":[{"device_id":7,"state":{}}]})",
          R"({"inverse3":[{"device_id":"b","state":{"cursor_position":{"x":"1","y":2,"z":3},"cursor_velocity":{"x":0,"y":0,"z":0}}}]})",
          R"({"inverse3":[{"device_id":"b","state":{"cursor_position":{"x":1e999,"y":2,"z":3},"cursor_velocity":{"x":0,"y":0,"z":0}}}]})"})
        EXPECT_FALSE(read_haply_message(bad, id, state)) << bad;
    EXPECT_EQ(id, before);
    EXPECT_FALSE(read_haply_message(std::string(60'000, '['), id, state));
}

TEST(DeviceHaply, CommandIsTheServicesJson) {
    const auto j = nlohmann::json::parse(haply_command("04\"9D", {0.5, -1e-7, 3}));
    EXPECT_EQ(j["inverse3"][0]["device_id"], "04\"9D");
    const auto& v = j["inverse3"][0]["commands"]["set_cursor_force"]["vector"];
    EXPECT_EQ(v["x"], 0.5);
    EXPECT_EQ(v["y"], -1e-7);
    EXPECT_EQ(v["z"], 3.0);
}

TEST(DeviceHaply, TenThousandMutantsAreSoundOrRefused) {
    const std::vector<mutate::Seed> seeds = {{"a.json", haply_state(0.01, true)}, {"b.json", haply_state(-1, false)}};
    size_t read = 0;
    for (uint64_t number = 0; number < 10'000; ++number) {
        std::string id;
        DeviceState state;
        if (!read_haply_message(mutate::make_mutant(seeds, number).bytes, id, state)) continue;
        ++read;
        ASSERT_TRUE(state.position.allFinite() && state.velocity.allFinite());
        ASSERT_FALSE(id.empty());
    }
    EXPECT_GT(read, 100u);
    EXPECT_LT(read, 9'900u);
}

// A service that sends scripted messages, one for every command, and keeps the commands.
class MockService {
 public:
    MockService(uint16_t port, std::vector<std::string> script) : script_(std::move(script)) {
        lws_set_log_level(0, nullptr);
        const lws_context_creation_info info = make_info(port);
        context_ = lws_create_context(&info);
        EXPECT_TRUE(context_);
        thread_ = std::thread([this] {
            while (!stop_ && context_ && lws_service(context_, 0) >= 0) {
            }
        });
    }
    ~MockService() {
        stop_ = true;
        lws_cancel_service(context_);
        thread_.join();
        lws_context_destroy(context_);
    }
    std::vector<std::string> commands() {
        const std::lock_guard lock(mutex_);
        return commands_;
    }
    size_t said() const { return next_; }

 private:
    lws_context_creation_info make_info(uint16_t port) {
        lws_context_creation_info info{};
        info.port = port;
        info.iface = "127.0.0.1";
        info.protocols = protocols_;
        info.user = this;
        info.gid = info.uid = static_cast<decltype(info.uid)>(-1);
        return info;
    }
    static int on_event(lws* socket, lws_callback_reasons reason, void*, void* in, size_t size) {
        if (reason == LWS_CALLBACK_ESTABLISHED) lws_callback_on_writable(socket);
        if (reason == LWS_CALLBACK_SERVER_WRITEABLE) return self(socket).say(socket);
        if (reason == LWS_CALLBACK_RECEIVE) {
            const std::lock_guard lock(self(socket).mutex_);
            self(socket).commands_.emplace_back(static_cast<const char*>(in), size);
            lws_callback_on_writable(socket);
        }
        return 0;
    }
    static MockService& self(lws* socket) { return *static_cast<MockService*>(lws_context_user(lws_get_context(socket))); }
    int say(lws* socket) {
        // after the script it repeats the last message; "close" ends the connection
        const std::string& text = script_[std::min(next_.load(), script_.size() - 1)];
        ++next_;
        if (text == "close") return -1;
        std::string bytes(LWS_PRE, '\0');
        bytes += text;
        lws_write(socket, reinterpret_cast<unsigned char*>(bytes.data()) + LWS_PRE, text.size(), LWS_WRITE_TEXT);
        return 0;
    }
    const lws_protocols protocols_[2] = {{"mock", on_event, 0, 4096, 0, nullptr, 0}, {nullptr, nullptr, 0, 0, 0, nullptr, 0}};
    std::vector<std::string> script_;
    std::atomic<size_t> next_{0};
    std::mutex mutex_;
    std::vector<std::string> commands_;
    lws_context* context_ = nullptr;
    std::atomic<bool> stop_{false};
    std::thread thread_;
};

TEST(DeviceHaply, TalksWithAMockService) {
    const uint16_t port = free_tcp_port();
    MockService service(port, {haply_state(0.01, false), haply_state(0.02, true)});
    const auto link = open_device("haply:127.0.0.1:" + std::to_string(port));
    ASSERT_TRUE(wait_until([&] { return link->read().state.position.x() == 0.02; }));
    EXPECT_EQ(link->read().state.buttons, 6u);
    const auto force_x = [&] {
        const std::vector<std::string> commands = service.commands();
        if (commands.empty()) return -1.0;
        return nlohmann::json::parse(commands.back())["inverse3"][0]["commands"]["set_cursor_force"]["vector"]["x"].get<double>();
    };
    EXPECT_TRUE(wait_until([&] { return force_x() == 0; }));  // commands of zero force keep the service sending
    DeviceCommand command;
    command.force = {1.25, 0, 0};
    EXPECT_TRUE(wait_until([&] {
        link->write(command, monotonic_ns());
        return force_x() == 1.25;
    }));
    EXPECT_TRUE(wait_until([&] { return force_x() == 0; }));  // the tick fell silent
    EXPECT_GT(count_of(*link, DeviceCount::kSent), 2u);
    EXPECT_EQ(count_of(*link, DeviceCount::kMalformed), 0u);
}

// Messages that are too long or not a state are dropped and counted; communication continues, also over a new
// connection.
TEST(DeviceHaply, BadMessagesAreDroppedAndCounted) {
    const uint16_t port = free_tcp_port();
    std::string large = haply_state(0.5, false);
    large.insert(1, "\"padding\":\"" + std::string(100'000, 'x') + "\",");
    ASSERT_TRUE(nlohmann::json::accept(large));
    MockService service(port, {haply_state(0.01, false), large, "{\"inverse3\":[]}", "no json at all", haply_state(0.02, false), "close",
                               haply_state(0.03, false)});
    const auto link = open_device("haply:" + std::to_string(port));
    ASSERT_TRUE(wait_until([&] { return link->read().state.position.x() == 0.03; }));
    EXPECT_EQ(count_of(*link, DeviceCount::kOversized), 1u);
    EXPECT_EQ(count_of(*link, DeviceCount::kMalformed), 2u);
    EXPECT_EQ(count_of(*link, DeviceCount::kReconnected), 1u);
}

TEST(DeviceHaply, WithoutAServiceItWaitsAndEndsWhenAsked) {
    const auto link = open_device("haply:" + std::to_string(free_tcp_port()));
    sleep_until_ns(monotonic_ns() + 50'000'000);
    EXPECT_EQ(link->read().received_ns, 0);
}

#endif

// ---- OpenIGTLink ----
#ifdef TROCAR_IGTL

igtl::TransformMessage::Pointer some_transform(float x) {
    igtl::Matrix4x4 m;
    igtl::IdentityMatrix(m);
    m[0][0] = 0, m[0][1] = -1, m[1][0] = 1, m[1][1] = 0;  // a quarter turn about z
    m[0][3] = x, m[1][3] = -20, m[2][3] = 30;
    igtl::TransformMessage::Pointer message = igtl::TransformMessage::New();
    message->SetDeviceName("Tool");
    message->SetMatrix(m);
    message->Pack();
    return message;
}
template <typename Message>
std::string bytes_of(Message& message) {
    return {static_cast<const char*>(message->GetPackPointer()), static_cast<size_t>(message->GetPackSize())};
}
bool read_text(const std::string& text, DeviceState& state) { return read_igtl_message(std::as_bytes(std::span(text)), state); }

TEST(DeviceIgtl, ReadsTransformsAndPositions) {
    DeviceState state;
    auto transform = some_transform(10);
    ASSERT_TRUE(read_text(bytes_of(transform), state));
    EXPECT_NEAR((state.position - Vec3d(0.01, -0.02, 0.03)).norm(), 0, 1e-9);
    EXPECT_NEAR((rotate(state.orientation, Vec3d::UnitX()) - Vec3d::UnitY()).norm(), 0, 1e-6);
    igtl::PositionMessage::Pointer position = igtl::PositionMessage::New();
    position->SetPosition(1, 2, 3);
    position->SetQuaternion(0, 0.6f, 0, 0.8f);
    position->Pack();
    ASSERT_TRUE(read_text(bytes_of(position), state));
    EXPECT_NEAR((state.position - Vec3d(0.001, 0.002, 0.003)).norm(), 0, 1e-9);
    EXPECT_NEAR(state.orientation.y, 0.6, 1e-6);
    igtl::StatusMessage::Pointer status = igtl::StatusMessage::New();
    status->SetCode(1);
    status->Pack();
    EXPECT_FALSE(read_text(bytes_of(status), state));
    std::string damaged = bytes_of(transform);
    damaged[70] = static_cast<char>(damaged[70] ^ 1);
    EXPECT_FALSE(read_text(damaged, state));  // its checksum tells
    EXPECT_FALSE(read_text(bytes_of(transform).substr(0, 57), state));
    EXPECT_FALSE(read_text(bytes_of(transform).substr(0, 100), state));
    igtl::Matrix4x4 m;
    igtl::IdentityMatrix(m);
    m[0][0] = 2;
    auto scaled = igtl::TransformMessage::New();
    scaled->SetMatrix(m);
    scaled->Pack();
    EXPECT_FALSE(read_text(bytes_of(scaled), state));
}

TEST(DeviceIgtl, FiveThousandMutantsAreSoundOrRefused) {
    auto transform = some_transform(10);
    igtl::PositionMessage::Pointer position = igtl::PositionMessage::New();
    position->SetPosition(1, 2, 3);
    position->Pack();
    const std::vector<mutate::Seed> seeds = {{"a.igtl", bytes_of(transform)}, {"b.igtl", bytes_of(position)}};
    size_t read = 0;
    for (uint64_t number = 0; number < 5'000; ++number) {
        DeviceState state;
        if (!read_text(mutate::make_mutant(seeds, number).bytes, state)) continue;
        ++read;
        ASSERT_TRUE(state.position.allFinite());
    }
    EXPECT_LT(read, 4'900u);
}

TEST(DeviceIgtl, TalksWithAMockServer) {
    const uint16_t port = free_tcp_port();
    igtl::ServerSocket::Pointer server = igtl::ServerSocket::New();
    ASSERT_EQ(server->CreateServer(port), 0);
    std::atomic<bool> stop{false};
    std::atomic<double> force{-1};
    std::thread serving([&] {
        igtl::ClientSocket::Pointer peer = server->WaitForConnection(10'000);
        if (peer.IsNull()) return;
        peer->SetReceiveTimeout(5);
        while (!stop && peer->GetConnected()) {
            auto transform = some_transform(10);
            peer->Send(transform->GetPackPointer(), transform->GetPackSize());
            igtl::MessageHeader::Pointer header = igtl::MessageHeader::New();
            header->InitPack();
            if (peer->Receive(header->GetPackPointer(), header->GetPackSize()) != header->GetPackSize()) continue;
            header->Unpack();
            igtl::SensorMessage::Pointer sensor = igtl::SensorMessage::New();
            sensor->SetMessageHeader(header);
            sensor->AllocatePack();
            peer->Receive(sensor->GetPackBodyPointer(), sensor->GetPackBodySize());
            sensor->Unpack(1);
            if (sensor->GetLength() == 6) force = sensor->GetValue(1);
        }
        peer->CloseSocket();
    });
    {
        const auto link = open_device("igtl:127.0.0.1:" + std::to_string(port));
        EXPECT_TRUE(wait_until([&] { return link->read().received_ns > 0; }));
        EXPECT_NEAR((link->read().state.position - Vec3d(0.01, -0.02, 0.03)).norm(), 0, 1e-9);
        DeviceCommand command;
        command.force = {0, 2.5, 0};
        EXPECT_TRUE(wait_until([&] {
            link->write(command, monotonic_ns());
            return force == 2.5;
        }));
        EXPECT_TRUE(wait_until([&] { return force == 0; }));
        EXPECT_EQ(count_of(*link, DeviceCount::kMalformed), 0u);
    }
    stop = true;
    serving.join();
    server->CloseSocket();
}

#endif

}  // namespace
}  // namespace trocar
