#include "systems/app/view/live_view.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <thread>

#include "engine/base/error.hpp"
#include "engine/geometry/quaternion.hpp"
#include "systems/app/console/resident_memory.hpp"
#include "systems/app/player/player_code.hpp"
#include "systems/app/player/player_page.hpp"
#include "systems/haptics/manipulator.hpp"
#include "tests/app/quick_scene.hpp"
namespace trocar {
namespace {

// A client that speaks HTTP and WebSocket by hand, so that it can also say what no browser would.
class RawClient {
 public:
    explicit RawClient(uint16_t port) : port_(port), socket_(socket(AF_INET, SOCK_STREAM, 0)) {
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(port);
        to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        const timeval patience{60, 0};
        setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
        EXPECT_EQ(connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0);
    }
    ~RawClient() {
        if (socket_ >= 0) close(socket_);
    }
    RawClient(const RawClient&) = delete;
    RawClient& operator=(const RawClient&) = delete;

    void send_bytes(const std::string& bytes) {
        for (size_t sent = 0; sent < bytes.size();) {
            const ssize_t n = send(socket_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
            if (n <= 0) return;
            sent += static_cast<size_t>(n);
        }
    }
    // Until the other side closes.
    std::string all() {
        while (receive()) {
        }
        return std::exchange(buffer_, {});
    }
    // An answer's head and `Content-Length` bytes.
    std::string answer_to(const std::string& request) {
        send_bytes(request);
        size_t end = std::string::npos;
        while ((end = buffer_.find("\r\n\r\n")) == std::string::npos)
            if (!receive()) return std::exchange(buffer_, {});
        const size_t at = buffer_.find("content-length: ");
        const size_t length = at < end ? std::stoul(buffer_.substr(at + 16)) : 0;
        while (buffer_.size() < end + 4 + length)
            if (!receive()) break;
        return std::exchange(buffer_, {});
    }
    // True if the server agrees to speak WebSocket.
    bool upgrade(const std::string& host, const std::string& origin, const std::string& protocol = "trocar-view") {
        send_bytes("GET / HTTP/1.1\r\nHost: " + host + "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n" +
                   (origin.empty() ? "" : "Origin: " + origin + "\r\n") +
                   "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: " + protocol +
                   "\r\n\r\n");
        size_t end = std::string::npos;
        while ((end = buffer_.find("\r\n\r\n")) == std::string::npos)
            if (!receive()) return false;
        const bool agreed = buffer_.starts_with("HTTP/1.1 101");
        buffer_.erase(0, end + 4);
        return agreed;
    }
    // As a browser greets.
    bool enter(const std::string& token) {
        const std::string host = "127.0.0.1:" + std::to_string(port_);
        if (!upgrade(host, "http://" + host)) return false;
        say(token);
        return true;
    }
    void say(const std::string& text) {
        std::string frame = "\x81";
        if (text.size() < 126) {
            frame += static_cast<char>(0x80 | text.size());
        } else {
            frame += static_cast<char>(0x80 | 126);
            frame += static_cast<char>(text.size() >> 8), frame += static_cast<char>(text.size() & 255);
        }
        frame += std::string(4, '\0');  // a mask that changes nothing
        send_bytes(frame + text);
    }
    // The next whole message; false if the server closed. Texts and bytes alike.
    bool hear(std::string& message) {
        message.clear();
        for (;;) {
            if (!need(2)) return false;
            const auto head = static_cast<uint8_t>(buffer_[0]);
            size_t length = static_cast<uint8_t>(buffer_[1]) & 127, at = 2;
            const size_t more = length == 126 ? 2 : length == 127 ? 8 : 0;
            if (!need(at + more)) return false;
            if (more > 0) length = 0;
            for (size_t i = 0; i < more; ++i) length = length << 8 | static_cast<uint8_t>(buffer_[at++]);
            if (!need(at + length)) return false;
            const std::string part = buffer_.substr(at, length);
            buffer_.erase(0, at + length);
            if ((head & 15) == 8) return false;
            if ((head & 15) > 2) continue;  // ping
            message += part;
            if (head & 128) return true;
        }
    }
    // The next message of bytes, of this kind; or with nothing but texts between, the last of these in `status`.
    bool hear_bytes(uint8_t kind, std::string& message) {
        while (hear(message)) {
            if (message.starts_with('{'))
                status = nlohmann::json::parse(message);
            else if (static_cast<uint8_t>(message[0]) == kind)
                return true;
        }
        return false;
    }
    bool hear_status(const std::function<bool(const nlohmann::json&)>& wanted) {
        for (std::string message; hear(message);)
            if (message.starts_with('{') && wanted(status = nlohmann::json::parse(message))) return true;
        return false;
    }
    nlohmann::json status;
    // Goes without a word, as a browser that is killed: the kernel resets the connection.
    void vanish() {
        const linger at_once{1, 0};
        setsockopt(socket_, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
        close(std::exchange(socket_, -1));
    }

 private:
    bool receive() {
        std::array<char, 65536> block;
        const ssize_t n = recv(socket_, block.data(), block.size(), 0);
        if (n > 0) buffer_.append(block.data(), static_cast<size_t>(n));
        return n > 0;
    }
    bool need(size_t bytes) {
        while (buffer_.size() < bytes)
            if (!receive()) return false;
        return true;
    }
    uint16_t port_;
    int socket_;
    std::string buffer_;
};

struct Port {
    uint16_t number;
    std::string token, host;
};
Port port_of(const LiveView& view) {
    const std::string address = view.address(), start = "http://127.0.0.1:";
    EXPECT_TRUE(address.starts_with(start));
    const size_t hash = address.find('#');
    const uint16_t number = static_cast<uint16_t>(std::stoul(address.substr(start.size())));
    return {number, address.substr(hash + 1), "127.0.0.1:" + std::to_string(number)};
}

// The quick scene, simulated as `trocar run --view` does.
class ViewedRun {
 public:
    ViewedRun() : frame(quick_scene(), {}), view(0), port(port_of(view)) {
        view.obey(0, R"({"do":"pause"})");  // nobody holds it yet, who is client 0
        view.attach(frame, "quick", {}, true);
        thread_ = std::thread([this] {
            while (view.wait_for_turn(frame)) {
                frame.step();
                view.after_pass(frame, frame.times().stage_ns);
            }
        });
    }
    ~ViewedRun() {
        view.end();
        end();
    }
    void end() {
        if (thread_.joinable()) thread_.join();
    }
    Frame frame;
    LiveView view;
    Port port;

 private:
    std::thread thread_;
};

#define NEEDS_VIEW() \
    if (!view_is_built() || !has_player()) GTEST_SKIP() << "built without libwebsockets, or without the player"

TEST(LiveView, OnlyItsOwnNamesAndFilesAreServed) {
    NEEDS_VIEW();
    ViewedRun run;
    const auto get = [&](const std::string& path, const std::string& host) {
        return RawClient(run.port.number).answer_to("GET " + path + " HTTP/1.1\r\nHost: " + host + "\r\n\r\n");
    };
    for (const std::string& name : {std::string("127.0.0.1"), std::string("localhost"), std::string("[::1]")}) {
        const std::string page = get("/", name + ":" + std::to_string(run.port.number));
        EXPECT_TRUE(page.starts_with("HTTP/1.1 200")) << page.substr(0, 200);
        EXPECT_NE(page.find("content-security-policy: default-src 'none'"), std::string::npos);
        EXPECT_EQ(page.find("access-control-allow-origin"), std::string::npos);
        EXPECT_EQ(page.find(run.port.token), std::string::npos);
    }
    const std::string script = get("/player.js", run.port.host);
    EXPECT_TRUE(script.starts_with("HTTP/1.1 200"));
    EXPECT_NE(script.find("content-encoding: deflate"), std::string::npos);
    EXPECT_EQ(script.substr(script.find("\r\n\r\n") + 4), packed_player_script());
    // a page that makes its own name mean 127.0.0.1 still says its own name
    for (const std::string& host : {std::string("evil.example"), "evil.example:" + std::to_string(run.port.number),
                                    std::string("127.0.0.1"), run.port.host + ".evil.example", std::string(300, 'x')})
        EXPECT_FALSE(get("/", host).starts_with("HTTP/1.1 200")) << host;
    for (const char* path : {"/../etc/passwd", "/etc/passwd", "/player.js/x", "/%2e%2e/%2e%2e/etc/passwd"})
        EXPECT_FALSE(get(path, run.port.host).starts_with("HTTP/1.1 200")) << path;
    EXPECT_FALSE(RawClient(run.port.number).answer_to("GET / HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 200"));
}

TEST(LiveView, SocketsOfOtherPagesAndWithoutTheTokenSeeNothing) {
    NEEDS_VIEW();
    ViewedRun run;
    const std::string good = "http://" + run.port.host;
    for (const std::string& origin : {std::string("http://evil.example"), std::string("null"), "https://" + run.port.host,
                                      good + ".evil.example", "http://127.0.0.1:" + std::to_string(run.port.number ^ 1)})
        EXPECT_FALSE(RawClient(run.port.number).upgrade(run.port.host, origin)) << origin;
    EXPECT_FALSE(RawClient(run.port.number).upgrade("evil.example", "http://evil.example"));
    EXPECT_FALSE(RawClient(run.port.number).upgrade(run.port.host, good, "chat"));
    std::string message;
    for (std::string token :
         {std::string(), run.port.token.substr(1), run.port.token + "0", std::string(32, '0'), std::string(5000, '0')}) {
        RawClient client(run.port.number);
        ASSERT_TRUE(client.upgrade(run.port.host, good));
        client.say(token);
        EXPECT_FALSE(client.hear(message)) << token << ": " << message;
    }
    for (const std::string& noise :
         {std::string("\xff\xff\xff\xff\xff\xff\xff\xff"), std::string("\x81\x05hello"), std::string(100000, '\x07')}) {
        RawClient client(run.port.number);
        ASSERT_TRUE(client.enter(run.port.token));
        client.send_bytes(noise);
        client.hear(message);  // or it was closed
    }
    RawClient client(run.port.number);
    ASSERT_TRUE(client.enter(run.port.token));
    EXPECT_TRUE(client.hear_bytes(0, message));
    for (const char* text : {"", "{", "[]", "17", R"({"do":17})", R"({"do":"hand","tip":"x"})",
                             R"({"do":"hand","body":1e300,"tip":[1,2,3]})", R"({"do":"hold"})", R"({"do":"speed","value":"fast"})",
                             R"({"do":"speed","value":-1})", R"({"do":"hand","body":-1,"tip":[null,1,2]})"})
        client.say(text);
    client.say(std::string(2000, '['));
    client.say(R"({"do":"pause"})");
    EXPECT_TRUE(client.hear_status([](const nlohmann::json& s) { return s["holds"] && s["paused"] && s["speed"] == 1; }));
}

// The bytes that the browser gets are those of a coder beside it, whose code is tested against the world in player_test.cpp; and
// from the start and the frames together every body is where it is.
TEST(LiveView, SteppingShowsEveryPassAsItIs) {
    NEEDS_VIEW();
    ViewedRun run;
    RawClient client(run.port.number);
    ASSERT_TRUE(client.enter(run.port.token));
    client.say(R"({"do":"hold"})");
    client.say(R"({"do":"pause"})");
    ASSERT_TRUE(client.hear_status([](const nlohmann::json& s) { return s["holds"] && s["paused"]; }));
    const uint64_t before = run.frame.world().clock.pass;
    constexpr int kSteps = 12;
    for (int step = 0; step < kSteps; ++step) client.say(R"({"do":"step"})");
    const double period = 1e-3 * run.frame.world().clock.period;
    const double goal = (static_cast<double>(before) + kSteps) * period;
    ASSERT_TRUE(client.hear_status([&](const nlohmann::json& s) { return s["time"].get<double>() > goal - 1e-9; }));
    RawClient late(run.port.number);  // comes when all has happened
    ASSERT_TRUE(late.enter(run.port.token));
    std::string start;
    ASSERT_TRUE(late.hear_bytes(0, start));
    client.say(R"({"do":"end"})");
    run.end();
    EXPECT_EQ(run.frame.world().clock.pass, before + kSteps);

    const World& w = run.frame.world();
    PlayerCoder coder(run.frame);
    coder.next(run.frame, {});
    const PlayerFrame whole = coder.whole(w);
    const std::vector<uint8_t> head = coder.start("quick", {}, 1);
    // what is equal to the last byte: header (but for limits), meshes, moves
    const auto moves = start.find(std::string(whole.moves.begin(), whole.moves.end()));
    EXPECT_NE(moves, std::string::npos);
    const uint8_t* at = whole.moves.data();
    for (uint32_t b = 0; b < coder.coordinates().size(); ++b) {
        take_number(at);
        const double step = w.meshes.info[w.bodies.mesh[b]].radius * PlayerCoder::kError * (is_deformable(w.bodies, b) ? 2 : 0.5);
        for (uint32_t i = 0; i < coder.coordinates()[b]; ++i) {
            const double value = static_cast<double>(take_signed(at)) * step;
            if (!is_deformable(w.bodies, b)) {
                if (i < 3) {
                    EXPECT_NEAR(value, (w.poses.origin[b] - coder.origin())[static_cast<int>(i)], step);
                }
                continue;
            }
            const Float4& offset = w.particles.offset[w.bodies.particles[b].first + i / 3];
            const float local[] = {offset.x, offset.y, offset.z};
            EXPECT_NEAR(value, (w.poses.origin[b] - coder.origin())[static_cast<int>(i % 3)] + static_cast<double>(local[i % 3]), step);
        }
    }
}

TEST(LiveView, TheFirstHoldsAndTheNextMayTakeOver) {
    NEEDS_VIEW();
    ViewedRun run;
    auto first = std::make_unique<RawClient>(run.port.number);
    ASSERT_TRUE(first->enter(run.port.token));
    first->say(R"({"do":"hold"})");
    first->say(R"({"do":"play"})");
    ASSERT_TRUE(first->hear_status([](const nlohmann::json& s) { return s["holds"] && !s["paused"]; }));
    RawClient second(run.port.number);
    ASSERT_TRUE(second.enter(run.port.token));
    for (const char* text : {R"({"do":"hold"})", R"({"do":"speed","value":0.5})", R"({"do":"pause"})", R"({"do":"end"})"}) second.say(text);
    ASSERT_TRUE(second.hear_status([](const nlohmann::json& s) { return s["held"] && s["clients"] == 2; }));
    first->say(R"({"do":"speed","value":2})");
    ASSERT_TRUE(second.hear_status([](const nlohmann::json& s) { return s["speed"] == 2; }));
    EXPECT_FALSE(second.status["paused"].get<bool>());
    first.reset();
    ASSERT_TRUE(second.hear_status([](const nlohmann::json& s) { return !s["held"]; }));
    second.say(R"({"do":"hold"})");
    second.say(R"({"do":"end"})");
    run.end();
}

// What the client that holds the run asks for reaches the simulation in its order; of others and of broken messages nothing does.
TEST(LiveView, CommandsOfTheHolderWaitForThePass) {
    NEEDS_VIEW();
    ViewedRun run;
    RawClient client(run.port.number), other(run.port.number);
    ASSERT_TRUE(client.enter(run.port.token));
    client.say(R"({"do":"hold"})");
    ASSERT_TRUE(client.hear_status([](const nlohmann::json& s) { return s["holds"].get<bool>(); }));
    ASSERT_TRUE(other.enter(run.port.token));
    other.say(R"({"do":"grab","body":0,"point":[1,2,3]})"), other.say(R"({"do":"capture"})");
    for (const char* text :
         {R"({"do":"grab","body":1,"point":[1,2,3]})", R"({"do":"pull","point":[4,5,6]})", R"({"do":"pull","point":[7,8,9]})",
          R"({"do":"pull","point":[7,8]})", R"({"do":"set","key":"gravity","value":"[0,0,0]"})", R"({"do":"capture"})", R"({"do":"let"})",
          R"({"do":"set","key":7,"value":"no text"})"})
        client.say(text);
    ASSERT_TRUE(
        client.hear_status([](const nlohmann::json& s) { return s["told"].get<std::string>().find("\"key\"") != std::string::npos; }));
    EXPECT_FALSE(client.status["captures"].get<bool>());
    EXPECT_FALSE(run.view.take_capture()) << "the run keeps none";
    const std::vector<ViewCommand> asked = run.view.take_commands();
    ASSERT_EQ(asked.size(), 4u);
    EXPECT_EQ(asked[0].kind, ViewCommand::Kind::kGrab);
    EXPECT_EQ(asked[0].body, 1u);
    EXPECT_EQ(asked[1].point, Vec3d(7, 8, 9)) << "the last of the pulls";
    EXPECT_EQ(asked[2].key, "gravity");
    EXPECT_EQ(asked[3].kind, ViewCommand::Kind::kLet);
    run.view.offer_captures(true);
    client.say(R"({"do":"capture"})");
    for (size_t i = 0; i < 3 * LiveView::kMostCommands; ++i) client.say(R"({"do":"set","key":"a","value":"b"})");
    client.say(R"({"do":"grab","body":0,"point":[0,0,0]})"), client.say(R"({"do":"let"})"), client.say(R"({"do":"pull"})");
    ASSERT_TRUE(
        client.hear_status([](const nlohmann::json& s) { return s["told"].get<std::string>().find("\"point\"") != std::string::npos; }));
    EXPECT_TRUE(run.view.take_capture());
    const std::vector<ViewCommand> most = run.view.take_commands();
    EXPECT_EQ(most.size(), LiveView::kMostCommands);
    EXPECT_EQ(most.back().kind, ViewCommand::Kind::kLet) << "never lost";
}

// A browser that is killed lets go of what it dragged and of the run; the next may have it. Again and again.
TEST(LiveView, ClientsThatAreKilledComeBack) {
    NEEDS_VIEW();
    ViewedRun run;
    for (int life = 0; life < 8; ++life) {
        RawClient client(run.port.number);
        ASSERT_TRUE(client.enter(run.port.token));
        std::string start;
        ASSERT_TRUE(client.hear_bytes(0, start)) << life;
        client.say(R"({"do":"hold"})");
        ASSERT_TRUE(client.hear_status([](const nlohmann::json& s) { return s["holds"].get<bool>(); })) << life;
        EXPECT_LE(client.status["clients"].get<int>(), 2);
        client.say(R"({"do":"grab","body":0,"point":[0,0,0]})"),
            client.say(R"({"do":"speed","value":)" + std::to_string(1 + life % 3) + "}");
        ASSERT_TRUE(client.hear_status([&](const nlohmann::json& s) { return s["speed"] == 1 + life % 3; }));
        run.view.take_commands();
        client.vanish();
        std::vector<ViewCommand> left;
        for (int i = 0; i < 2000 && left.empty(); ++i) {
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
            left = run.view.take_commands();
        }
        ASSERT_EQ(left.size(), 1u) << life;
        EXPECT_EQ(left[0].kind, ViewCommand::Kind::kLet);
    }
}

// A browser that does not read keeps neither the run nor others from going on; when it reads again it gets what is, not all that was.
TEST(LiveView, AClientThatStallsIsBroughtUpToDate) {
    NEEDS_VIEW();
    ViewedRun run;
    RawClient stalled(run.port.number), lively(run.port.number);
    ASSERT_TRUE(stalled.enter(run.port.token));
    ASSERT_TRUE(lively.enter(run.port.token));
    lively.say(R"({"do":"hold"})"), lively.say(R"({"do":"speed","value":100})"), lively.say(R"({"do":"play"})");
    std::string message;
    int frames = 0;
    while (frames < 90 && lively.hear_bytes(1, message)) ++frames;  // three seconds of pictures
    EXPECT_EQ(frames, 90);
    lively.say(R"({"do":"pause"})");
    ASSERT_TRUE(lively.hear_status([](const nlohmann::json& s) { return s["paused"].get<bool>(); }));
    const uint64_t passes = run.frame.world().clock.pass;
    double newest = -1;
    int heard = 0;
    const double goal = 1e-3 * static_cast<double>(run.frame.world().clock.tick);
    ASSERT_TRUE(stalled.hear_status([&](const nlohmann::json& s) {
        newest = s["time"].get<double>(), ++heard;
        return newest >= goal - 1e-9;
    }));
    EXPECT_GT(passes, 90u);
    EXPECT_LT(heard, 120) << "pictures, not passes";
}

// Frames for a browser that does not read are dropped beyond kMostWaiting: it gets a new start, and the server keeps no more.
TEST(LiveView, AClientThatStallsMakesTheServerKeepLittle) {
    NEEDS_VIEW();
    constexpr size_t kBytes = 1 << 20, kFrames = 400;
    ViewServer server(0, {"", ""}, {[](uint32_t, const std::string&) {}, [](uint32_t) {}});
    RawClient stalled(server.port());
    ASSERT_TRUE(stalled.enter(server.token()));
    while (server.clients() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    size_t starts = 0, sent = 0;
    const double before = resident_bytes();
    double most = before;
    while (sent < kFrames) {
        if (!server.begin()) continue;
        if (server.has_newcomers()) server.send_start({static_cast<uint8_t>(++starts)});
        PlayerFrame frame;
        frame.findings.assign(kBytes, static_cast<uint8_t>(++sent));
        server.send_frame(std::move(frame), {});
        server.end();
        most = std::max(most, resident_bytes());
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_GT(starts, 2u) << "it fell behind";
    // the frames that wait, and as many that are being joined and written
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they keep freed memory for a while
    EXPECT_LT(most - before, 3.0 * ViewServer::kMostWaiting * kBytes);
#endif
    std::string message;
    size_t heard = 0;
    do {
        ASSERT_TRUE(stalled.hear(message));
        heard += message.size();
    } while (!(message.size() == 2 && static_cast<uint8_t>(message[1]) == static_cast<uint8_t>(starts)));
    EXPECT_LT(heard, kFrames * kBytes / 4);
}

TEST(LiveView, APortInUseIsAnError) {
    NEEDS_VIEW();
    const ViewedRun run;
    EXPECT_THROW(LiveView another(run.port.number), InputError);
}

TEST(BrowserHand, BringsTheTipToTheMouseWhateverHoldsTheTool) {
    HandTool plain, turned, through;
    turned.workspace = {{0.1, -0.2, 0.3}, normalized({0.7, 0.1, -0.5, 0.3}), 2.5, 0};
    through.pivot = {PivotKind::kHandle, {0, 0, 0.2}, 0.33, {0, 0, -1}};
    for (const HandTool& tool : {plain, turned, through}) {
        DeviceState start;
        start.position = {0.01, 0.02, 0.4};
        BrowserHand hand(tool, start);
        const Vec3d target = hand.start_tip() + Vec3d(0.03, -0.04, 0.02);
        hand.aim({target, 0.3, 5});
        hand.aim({Vec3d(0, 0, NAN), 0, 0});
        Vec3d before = hand.start_tip();
        DeviceState state;
        for (int ms = 0; ms < 500; ++ms) {
            ClutchState clutch;
            state = hand.step();
            const Vec3d tip = place_tool(tool, state, clutch).position;
            EXPECT_LE((tip - before).norm(), BrowserHand::kFastest * 1e-3 * (1 + 1e-6));
            before = tip;
        }
        EXPECT_LT((before - target).norm(), 1e-9);
        EXPECT_EQ(state.grip, 0.3);
        EXPECT_EQ(state.buttons, 5u);
        EXPECT_LT(state.velocity.norm(), 1e-6);
    }
}

}  // namespace
}  // namespace trocar
