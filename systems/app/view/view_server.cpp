#include "systems/app/view/view_server.hpp"

#include "engine/base/error.hpp"
#ifdef TROCAR_WEBSOCKETS
#include <libwebsockets.h>
#include <sys/random.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <mutex>
#include <thread>

#include "engine/jobs/real_time.hpp"
#include "systems/app/player/player_code.hpp"
#endif
namespace trocar {

#ifndef TROCAR_WEBSOCKETS

struct ViewServer::Inside {
    std::string token;
};
bool view_is_built() { return false; }
ViewServer::ViewServer(uint16_t, ViewFiles, ViewEvents) { throw InputError("--view: this program was built without libwebsockets"); }
ViewServer::~ViewServer() = default;
std::string ViewServer::address() const { return ""; }
uint16_t ViewServer::port() const { return 0; }
const std::string& ViewServer::token() const { return inside_->token; }
size_t ViewServer::clients() const { return 0; }
bool ViewServer::begin() { return false; }
bool ViewServer::has_newcomers() const { return false; }
void ViewServer::send_start(std::vector<uint8_t>) {}
void ViewServer::send_frame(PlayerFrame, std::span<const uint32_t>) {}
void ViewServer::send_status(const std::function<std::string(uint32_t)>&) {}
void ViewServer::end() {}
void ViewServer::restart() {}

#else

namespace {

constexpr size_t kChunk = 16384;  // bytes of an answer at a time
constexpr const char* kSocketProtocol = "trocar-view";
enum class MessageKind : uint8_t { kStart, kFrame };

std::string new_token() {
    std::array<uint8_t, 16> random{};
    if (getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size())) throw InputError("--view: no random numbers");
    std::string text;
    for (const uint8_t byte : random)
        for (const int nibble : {byte >> 4, byte & 15}) text += "0123456789abcdef"[nibble];
    return text;
}

// Takes as long for any wrong text.
bool same_text(const std::string& a, const std::string& b) {
    if (a.size() != b.size()) return false;
    unsigned differences = 0;
    for (size_t i = 0; i < a.size(); ++i) differences |= static_cast<unsigned>(a[i] ^ b[i]);
    return differences == 0;
}

std::string header_of(lws* socket, lws_token_indexes which) {
    std::array<char, 256> text{};
    const int length = lws_hdr_copy(socket, text.data(), static_cast<int>(text.size()), which);
    return length > 0 ? std::string(text.data(), static_cast<size_t>(length)) : "";
}

struct Client {
    uint32_t id = 0;  // 0 = none
    lws* socket = nullptr;
    bool admitted = false, waits_for_start = false, too_long = false;
    std::string text;                                         // of the incoming message
    std::vector<uint8_t> start;                               // empty = none to send
    std::deque<std::shared_ptr<const PlayerFrame>> waiting;  // frames
    std::string status;                                       // empty = none to send
};

// What a request for a file has still to send.
struct Answer {
    const std::string* body;
    size_t sent;
};

}  // namespace

struct ViewServer::Inside {
    ViewFiles files;
    ViewEvents events;
    std::string token = new_token();
    std::vector<std::string> hosts;  // that requests may name
    uint16_t port = 0;
    lws_context* context = nullptr;
    std::thread thread;
    std::atomic<bool> stop{false};
    std::atomic<size_t> admitted{0};
    std::mutex lock;  // of what follows
    std::vector<Client> clients;
    std::shared_ptr<const std::vector<uint32_t>> coordinates;
    uint32_t next_id = 1;

    bool knows_host(lws* socket) const { return std::ranges::count(hosts, header_of(socket, WSI_TOKEN_HOST)) > 0; }
    bool knows_origin(lws* socket) const {
        const std::string origin = header_of(socket, WSI_TOKEN_ORIGIN);
        return origin.empty() || std::ranges::any_of(hosts, [&](const std::string& host) { return origin == "http://" + host; });
    }
    Client* client_of(lws* socket) {
        const auto found = std::ranges::find(clients, socket, &Client::socket);
        return found == clients.end() ? nullptr : &*found;
    }
    int on_request(lws* socket, const std::string& path, Answer& answer);
    int on_answer(lws* socket, Answer& answer) const;
    int on_connect(lws* socket);
    int on_receive(lws* socket, const char* data, size_t size);
    int on_writable(lws* socket);
    void on_close(lws* socket);
    void wake_all();
    void serve();
};

namespace {

bool add_header(lws* socket, const char* name, const std::string& value, unsigned char*& at, unsigned char* end) {
    return lws_add_http_header_by_name(socket, reinterpret_cast<const unsigned char*>(name),
                                       reinterpret_cast<const unsigned char*>(value.data()), static_cast<int>(value.size()), &at, end) == 0;
}

int refuse(lws* socket, unsigned status) {
    lws_return_http_status(socket, status, nullptr);
    return -1;
}

int write_message(lws* socket, MessageKind kind, const std::vector<uint8_t>& bytes) {
    std::vector<uint8_t> message(LWS_PRE + 1);
    message.back() = static_cast<uint8_t>(kind);
    message.insert(message.end(), bytes.begin(), bytes.end());
    return lws_write(socket, message.data() + LWS_PRE, message.size() - LWS_PRE, LWS_WRITE_BINARY) < 0 ? -1 : 0;
}

// Frames that follow each other, as one.
PlayerFrame joined(const std::deque<std::shared_ptr<const PlayerFrame>>& frames, std::span<const uint32_t> coordinates) {
    PlayerFrame all = *frames.front();
    for (size_t i = 1; i < frames.size(); ++i) {
        const PlayerFrame& next = *frames[i];
        all.moves = join_moves(all.moves, next.moves, coordinates);
        all.surfaces.insert(all.surfaces.end(), next.surfaces.begin(), next.surfaces.end());
        all.time = next.time, all.pass = next.pass, all.cost_us = next.cost_us;
        all.findings = next.findings;
    }
    return all;
}

}  // namespace

// Answers with the page or the script; closes the connection (-1) on whatever else is asked.
int ViewServer::Inside::on_request(lws* socket, const std::string& path, Answer& answer) {
    const bool is_page = path == "/", is_script = path == "/player.js";
    if (!knows_host(socket)) return refuse(socket, HTTP_STATUS_FORBIDDEN);
    if (!is_page && !is_script) return refuse(socket, HTTP_STATUS_NOT_FOUND);
    answer = {is_page ? &files.page : &files.script, 0};
    std::array<unsigned char, LWS_PRE + 2048> buffer;
    unsigned char *const begin = buffer.data() + LWS_PRE, *at = begin, *const end = buffer.data() + buffer.size() - 1;
    // named beside 'self', which not every browser takes to mean sockets; an address in brackets may not be named
    const std::string number = std::to_string(port), sockets = "ws://127.0.0.1:" + number + " ws://localhost:" + number;
    if (lws_add_http_common_headers(socket, HTTP_STATUS_OK, is_page ? "text/html; charset=utf-8" : "text/javascript", answer.body->size(),
                                    &at, end) != 0 ||
        (is_script && !add_header(socket, "content-encoding:", "deflate", at, end)) ||
        !add_header(socket, "content-security-policy:",
                    "default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; img-src data: blob:; connect-src 'self' " + sockets +
                        "; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
                    at, end) ||
        !add_header(socket, "x-content-type-options:", "nosniff", at, end) ||
        !add_header(socket, "referrer-policy:", "no-referrer", at, end) ||
        !add_header(socket, "cross-origin-resource-policy:", "same-origin", at, end) ||
        !add_header(socket, "cache-control:", "no-store", at, end) || lws_finalize_write_http_header(socket, begin, &at, end) != 0)
        return -1;
    lws_callback_on_writable(socket);
    return 0;
}

int ViewServer::Inside::on_answer(lws* socket, Answer& answer) const {
    if (!answer.body) return -1;
    const size_t size = std::min(kChunk, answer.body->size() - answer.sent);
    std::array<unsigned char, LWS_PRE + kChunk> buffer;
    std::copy_n(answer.body->data() + answer.sent, size, buffer.data() + LWS_PRE);
    answer.sent += size;
    const bool is_last = answer.sent == answer.body->size();
    if (lws_write(socket, buffer.data() + LWS_PRE, size, is_last ? LWS_WRITE_HTTP_FINAL : LWS_WRITE_HTTP) < 0) return -1;
    if (!is_last) return lws_callback_on_writable(socket) < 0 ? -1 : 0;
    return lws_http_transaction_completed(socket) != 0 ? -1 : 0;
}

int ViewServer::Inside::on_connect(lws* socket) {
    const std::lock_guard guard(lock);
    if (clients.size() >= kMostClients) return -1;
    clients.emplace_back();
    clients.back().id = next_id++;
    clients.back().socket = socket;
    lws_set_timeout(socket, PENDING_TIMEOUT_USER_REASON_BASE, kPatience);
    return 0;
}

int ViewServer::Inside::on_receive(lws* socket, const char* data, size_t size) {
    Client* client = client_of(socket);  // this thread alone changes the list
    if (!client || client->text.size() + size > kLongestMessage) return -1;
    client->text.append(data, size);
    if (!lws_is_final_fragment(socket) || lws_remaining_packet_payload(socket) > 0) return 0;
    const std::string text = std::exchange(client->text, {});
    if (client->admitted) {
        events.message(client->id, text);
        return 0;
    }
    if (!same_text(text, token)) return -1;
    lws_set_timeout(socket, NO_PENDING_TIMEOUT, 0);
    const std::lock_guard guard(lock);
    client->admitted = client->waits_for_start = true;
    ++admitted;
    return 0;
}

// One message a call: the start before frames, frames before a status.
int ViewServer::Inside::on_writable(lws* socket) {
    std::vector<uint8_t> start;
    std::deque<std::shared_ptr<const PlayerFrame>> frames;
    std::string status;
    std::shared_ptr<const std::vector<uint32_t>> shape;
    bool more = false;
    {
        const std::lock_guard guard(lock);
        Client* client = client_of(socket);
        if (!client || !client->admitted) return 0;
        if (!client->start.empty())
            start = std::exchange(client->start, {});
        else if (!client->waiting.empty())
            frames = std::exchange(client->waiting, {});
        else
            status = std::exchange(client->status, {});
        shape = coordinates;
        more = !client->waiting.empty() || !client->status.empty();
    }
    int result = 0;
    if (!start.empty()) {
        result = write_message(socket, MessageKind::kStart, start);
    } else if (!frames.empty()) {
        std::vector<uint8_t> bytes;
        const PlayerFrame frame = joined(frames, *shape);
        put_frames(bytes, std::span(&frame, 1));
        result = write_message(socket, MessageKind::kFrame, bytes);
    } else if (!status.empty()) {
        std::vector<unsigned char> bytes(LWS_PRE + status.size());
        std::copy(status.begin(), status.end(), bytes.begin() + LWS_PRE);
        result = lws_write(socket, bytes.data() + LWS_PRE, status.size(), LWS_WRITE_TEXT) < 0 ? -1 : 0;
    }
    if (more) lws_callback_on_writable(socket);
    return result;
}

void ViewServer::Inside::on_close(lws* socket) {
    uint32_t gone = 0;
    {
        const std::lock_guard guard(lock);
        Client* client = client_of(socket);
        if (!client) return;
        if (client->admitted) --admitted, gone = client->id;
        clients.erase(clients.begin() + (client - clients.data()));
    }
    if (gone != 0) events.left(gone);
}

void ViewServer::Inside::wake_all() {
    for (const Client& client : clients) lws_callback_on_writable(client.socket);
}

namespace {

// Files over HTTP. The server's data are the context's, as in on_socket.
int on_http(lws* socket, lws_callback_reasons reason, void* user, void* in, size_t size) {
    auto* const answer = static_cast<Answer*>(user);
    auto& inside = *static_cast<ViewServer::Inside*>(lws_context_user(lws_get_context(socket)));
    switch (reason) {
        case LWS_CALLBACK_HTTP:
            return inside.on_request(socket, std::string(static_cast<const char*>(in), size), *answer);
        case LWS_CALLBACK_HTTP_WRITEABLE:
            return inside.on_answer(socket, *answer);
        case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION:
        case LWS_CALLBACK_ESTABLISHED:
        case LWS_CALLBACK_HTTP_BODY:
            return -1;  // a socket of no protocol, a form
        case LWS_CALLBACK_EVENT_WAIT_CANCELLED:
            inside.wake_all();
            return 0;
        default:
            return 0;
    }
}

int on_socket(lws* socket, lws_callback_reasons reason, void*, void* in, size_t size) {
    auto& inside = *static_cast<ViewServer::Inside*>(lws_context_user(lws_get_context(socket)));
    switch (reason) {
        case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION:
            return inside.knows_host(socket) && inside.knows_origin(socket) ? 0 : -1;
        case LWS_CALLBACK_ESTABLISHED:
            return inside.on_connect(socket);
        case LWS_CALLBACK_RECEIVE:
            return inside.on_receive(socket, static_cast<const char*>(in), size);
        case LWS_CALLBACK_SERVER_WRITEABLE:
            return inside.on_writable(socket);
        case LWS_CALLBACK_CLOSED:
            inside.on_close(socket);
            return 0;
        default:
            return 0;
    }
}

const lws_protocols kProtocols[] = {{"http", on_http, sizeof(Answer), 4096, 0, nullptr, 0},
                                    {kSocketProtocol, on_socket, 0, 4096, 0, nullptr, 0},
                                    {nullptr, nullptr, 0, 0, 0, nullptr, 0}};

lws_context_creation_info listening(const char* interface, uint16_t port) {
    lws_context_creation_info info{};
    info.port = port;
    info.iface = interface;
    info.vhost_name = interface;
    info.protocols = kProtocols;
    info.options = LWS_SERVER_OPTION_EXPLICIT_VHOSTS | LWS_SERVER_OPTION_FAIL_UPON_UNABLE_TO_BIND;
    return info;
}

// Only ends the wait for events.
void look_at_stop(lws_sorted_usec_list_t*) {}

}  // namespace

void ViewServer::Inside::serve() {
    request_low_priority();
    lws_sorted_usec_list_t look{};
    while (!stop) {
        lws_sul_schedule(context, 0, &look, look_at_stop, 100'000);
        if (lws_service(context, 0) < 0) break;
    }
    lws_sul_schedule(context, 0, &look, look_at_stop, LWS_SET_TIMER_USEC_CANCEL);
}

bool view_is_built() { return true; }

ViewServer::ViewServer(uint16_t port, ViewFiles files, ViewEvents events) : inside_(std::make_unique<Inside>()) {
    Inside& in = *inside_;
    in.files = std::move(files), in.events = std::move(events);
    lws_set_log_level(0, nullptr);
    lws_context_creation_info info = listening(nullptr, CONTEXT_PORT_NO_LISTEN);
    info.user = &in;
    info.gid = info.uid = static_cast<decltype(info.uid)>(-1);
    in.context = lws_create_context(&info);
    if (!in.context) throw InputError("--view: libwebsockets does not start");
    info = listening("127.0.0.1", port);
    lws_vhost* const vhost = lws_create_vhost(in.context, &info);
    if (!vhost) {
        lws_context_destroy(in.context);
        throw InputError("--view: port " + std::to_string(port) + " is in use, or may not be listened on");
    }
    in.port = static_cast<uint16_t>(lws_get_vhost_listen_port(vhost));
    info = listening("::1", in.port);
    lws_create_vhost(in.context, &info);  // not everywhere
    for (const char* name : {"127.0.0.1:", "localhost:", "[::1]:"}) in.hosts.push_back(name + std::to_string(in.port));
    in.thread = std::thread([&in] { in.serve(); });
}

ViewServer::~ViewServer() {
    inside_->stop = true;
    lws_cancel_service(inside_->context);
    inside_->thread.join();
    lws_context_destroy(inside_->context);
}

std::string ViewServer::address() const { return "http://127.0.0.1:" + std::to_string(inside_->port) + "/#" + inside_->token; }
uint16_t ViewServer::port() const { return inside_->port; }
const std::string& ViewServer::token() const { return inside_->token; }
size_t ViewServer::clients() const { return inside_->admitted; }

bool ViewServer::begin() { return inside_->admitted > 0 && inside_->lock.try_lock(); }

bool ViewServer::has_newcomers() const { return std::ranges::any_of(inside_->clients, &Client::waits_for_start); }

void ViewServer::send_start(std::vector<uint8_t> bytes) {
    for (Client& client : inside_->clients) {
        if (!client.waits_for_start) continue;
        client.start = bytes;
        client.waits_for_start = false;
    }
}

void ViewServer::send_frame(PlayerFrame frame, std::span<const uint32_t> coordinates) {
    if (!inside_->coordinates || !std::ranges::equal(*inside_->coordinates, coordinates))
        inside_->coordinates = std::make_shared<const std::vector<uint32_t>>(coordinates.begin(), coordinates.end());
    const auto shared = std::make_shared<const PlayerFrame>(std::move(frame));
    for (Client& client : inside_->clients) {
        if (!client.admitted || client.waits_for_start) continue;
        client.waiting.push_back(shared);
        if (client.waiting.size() > kMostWaiting) client.waiting.clear(), client.start.clear(), client.waits_for_start = true;
    }
}

void ViewServer::send_status(const std::function<std::string(uint32_t)>& text) {
    for (Client& client : inside_->clients)
        if (client.admitted && !client.waits_for_start) client.status = text(client.id);
}

void ViewServer::end() {
    inside_->lock.unlock();
    lws_cancel_service(inside_->context);
}

void ViewServer::restart() {
    const std::lock_guard guard(inside_->lock);
    for (Client& client : inside_->clients)
        if (client.admitted) client.waits_for_start = true, client.start.clear(), client.waiting.clear();
}

#endif

}  // namespace trocar
