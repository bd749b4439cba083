#pragma once
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "systems/app/player/player_coder.hpp"
namespace trocar {

// What the server hands out over HTTP.
struct ViewFiles {
    std::string page;    // HTML, at /
    std::string script;  // JavaScript compressed by zlib, at /player.js
};

// Called on the server's thread.
struct ViewEvents {
    std::function<void(uint32_t client, const std::string& text)> message;  // of an admitted client
    std::function<void(uint32_t client)> left;                              // an admitted client went
};

// Serves one page and a stream of frames to browsers on this machine: a thread of its own, which never makes a pass wait.
//
// Only programs on this machine that know the token are served. It listens on 127.0.0.1 and, where there is one, ::1; it
// refuses requests whose Host is not one of those names with its port (a page that rebinds its own name to 127.0.0.1 sends its
// own name), sockets whose Origin is another page's, and sockets whose first message within kPatience is not the token, which
// stands after # in the address and so never travels in a request.
//
// A client gets a start message (byte 0, then a recording of one frame in the format of page/data.js), then frames (byte 1, then
// a frame and its findings, as steps from the one before) and status texts. Who is slow gets frames joined into one, and who
// falls behind by more than kMostWaiting a new start: no client makes the program keep more.
class ViewServer {
 public:
    static constexpr size_t kMostClients = 16, kMostWaiting = 32, kLongestMessage = 4096;
    static constexpr int kPatience = 5;  // s, for the token

    // Port 0: any free one. Throws InputError if the port cannot be had, or if the program was built without libwebsockets.
    ViewServer(uint16_t port, ViewFiles files, ViewEvents events);
    ~ViewServer();
    ViewServer(const ViewServer&) = delete;
    ViewServer& operator=(const ViewServer&) = delete;

    std::string address() const;  // "http://127.0.0.1:PORT/#TOKEN"
    uint16_t port() const;
    const std::string& token() const;
    size_t clients() const;

    // The simulation's side; all calls from one thread. begin() is false if nobody is there, or if the server is at its list of
    // clients just then: try again at the next frame. Between begin() and end() the list is locked.
    bool begin();
    bool has_newcomers() const;  // clients without a start
    void send_start(std::vector<uint8_t> bytes);
    // To all that have started. `coordinates`: PlayerCoder::coordinates.
    void send_frame(PlayerFrame frame, std::span<const uint32_t> coordinates);
    void send_status(const std::function<std::string(uint32_t client)>& text);
    void end();
    // The next start is of another world: clients wait for it.
    void restart();

    struct Inside;  // of view_server.cpp

 private:
    std::unique_ptr<Inside> inside_;
};

bool view_is_built();

}  // namespace trocar
