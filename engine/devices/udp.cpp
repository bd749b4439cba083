#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "engine/devices/backends.hpp"
#include "engine/devices/packets.hpp"
#include "engine/jobs/real_time.hpp"
namespace trocar {
namespace {

constexpr uint32_t kPacketsPerCall = 32;       // packets a system call
constexpr uint32_t kMostARound = 64;           // batches before commands are sent again
constexpr int64_t kRest = 200'000;             // ns between rounds: a flood is read in few wake-ups
constexpr int64_t kPeerSilence = 500'000'000;  // ns, after which another sender is served
constexpr size_t kRoom = 256;                  // bytes; makes longer packets recognisable

struct Socket {
    int fd = -1;
    ~Socket() {
        if (fd >= 0) ::close(fd);
    }
};

struct Batch {
    std::array<std::array<std::byte, kRoom>, kPacketsPerCall> bytes;
    std::array<sockaddr_in, kPacketsPerCall> from;
    std::array<iovec, kPacketsPerCall> buffer;
    std::array<mmsghdr, kPacketsPerCall> message;
    alignas(cmsghdr) std::array<std::array<char, CMSG_SPACE(sizeof(uint32_t))>, kPacketsPerCall> control;

    int receive(int fd) {
        for (uint32_t k = 0; k < kPacketsPerCall; ++k) {
            buffer[k] = {bytes[k].data(), bytes[k].size()};
            message[k] = {};
            message[k].msg_hdr.msg_name = &from[k];
            message[k].msg_hdr.msg_namelen = sizeof from[k];
            message[k].msg_hdr.msg_iov = &buffer[k];
            message[k].msg_hdr.msg_iovlen = 1;
            message[k].msg_hdr.msg_control = control[k].data();
            message[k].msg_hdr.msg_controllen = control[k].size();
        }
        return ::recvmmsg(fd, message.data(), kPacketsPerCall, MSG_DONTWAIT, nullptr);
    }
};

// State of one device's connection.
struct Talk {
    DeviceChannel& link;
    sockaddr_in peer{};
    bool has_peer = false;
    int64_t peer_heard = 0;
    SequenceGate gate = {};
    uint32_t overrun = 0;  // the system's count
    StatePacket newest = {};
    bool news = false;
    uint64_t sent = 0;
    int64_t commanded = 0;  // ns, time of the last command from the tick
    bool released = true;   // a zero command was sent since

    bool is_peer(const sockaddr_in& from) const {
        return has_peer && from.sin_addr.s_addr == peer.sin_addr.s_addr && from.sin_port == peer.sin_port;
    }

    void count_overrun(msghdr& header) {
        for (cmsghdr* c = CMSG_FIRSTHDR(&header); c; c = CMSG_NXTHDR(&header, c)) {
            if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SO_RXQ_OVFL) continue;
            uint32_t total = 0;
            std::memcpy(&total, CMSG_DATA(c), sizeof total);
            link.count(DeviceCount::kOverrun, total - overrun);
            overrun = total;
        }
    }

    void take(std::span<const std::byte> bytes, bool truncated, const sockaddr_in& from, int64_t now) {
        link.count(DeviceCount::kReceived);
        if (truncated) return link.count(DeviceCount::kOversized);
        StatePacket packet;
        const PacketFault fault = decode_packet(bytes, packet);
        if (fault == PacketFault::kLong) return link.count(DeviceCount::kOversized);
        if (fault != PacketFault::kNone) return link.count(DeviceCount::kMalformed);
        const bool changes = has_peer && !is_peer(from);
        if (changes && now - peer_heard <= kPeerSilence) return link.count(DeviceCount::kStranger);
        if (changes) gate = {}, link.count(DeviceCount::kReconnected);
        uint64_t lost = 0;
        if (gate.pass(packet.sequence, now, lost) == SequenceGate::Verdict::kStale) return link.count(DeviceCount::kOutOfOrder);
        link.count(DeviceCount::kLost, lost);
        peer = from;
        has_peer = true;
        peer_heard = now;
        // of several waiting samples the newest is published; all of them count
        if (news) link.count(DeviceCount::kAccepted);
        newest = packet;
        news = true;
    }

    void publish(int64_t now) {
        if (!news) return;
        link.publish(newest.state, now);
        news = false;
    }

    void answer(int fd, int64_t now) {
        bool fresh = false;
        const DeviceCommand command = link.command(now, fresh);
        if (fresh)
            commanded = now, released = false;
        else if (released || now - commanded <= DeviceChannel::kSilence)
            return;
        else
            released = true;
        if (!has_peer) return;
        const auto bytes = encode_packet(ForcePacket{++sent, newest.sequence, newest.state.time, command});
        const ssize_t done =
            ::sendto(fd, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&peer), sizeof peer);
        if (done == static_cast<ssize_t>(bytes.size())) link.count(DeviceCount::kSent);
    }
};

void serve(DeviceChannel& link, int fd) {
    const auto batch = std::make_unique<Batch>();
    Talk talk{link};
    while (!link.stopping()) {
        pollfd wanted{fd, POLLIN, 0};
        ::poll(&wanted, 1, 1);
        int64_t now = monotonic_ns();
        for (uint32_t round = 0; round < kMostARound; ++round) {
            const int count = batch->receive(fd);
            for (int k = 0; k < count; ++k) {
                mmsghdr& m = batch->message[k];
                talk.count_overrun(m.msg_hdr);
                talk.take(std::span(batch->bytes[k]).first(std::min<size_t>(m.msg_len, kRoom)), (m.msg_hdr.msg_flags & MSG_TRUNC) != 0,
                          batch->from[k], now);
            }
            if (count < static_cast<int>(kPacketsPerCall)) break;
        }
        talk.publish(now);
        talk.answer(fd, now);
        sleep_until_ns(now + kRest);
    }
}

}  // namespace

std::unique_ptr<DeviceLink> open_udp_device(const std::string& specification, const NetworkAddress& target) {
    auto socket = std::make_shared<Socket>();
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(target.port);
    const std::string host = target.host == "localhost" ? "127.0.0.1" : target.host;
    if (::inet_pton(AF_INET, host.c_str(), &address.sin_addr) != 1)
        refuse_device(specification, "\"" + target.host + "\" is no IPv4 address of this machine");
    socket->fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (socket->fd < 0) refuse_device(specification, std::strerror(errno));
    const int yes = 1;
    ::setsockopt(socket->fd, SOL_SOCKET, SO_RXQ_OVFL, &yes, sizeof yes);
    if (::bind(socket->fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
        refuse_device(specification,
                      "cannot listen at " + target.host + ":" + std::to_string(target.port) + " (" + std::strerror(errno) + ")");
    return std::make_unique<DeviceLink>("UDP " + target.host + ":" + std::to_string(target.port),
                                        [socket](DeviceChannel& link) { serve(link, socket->fd); });
}

}  // namespace trocar
