#include <cmath>
#include <cstring>

#include "engine/devices/backends.hpp"
#include "engine/devices/packets.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/real_time.hpp"
#ifdef TROCAR_IGTL
#include <igtlClientSocket.h>
#include <igtlMessageHeader.h>
#include <igtlPositionMessage.h>
#include <igtlSensorMessage.h>
#include <igtlTransformMessage.h>
#endif
namespace trocar {

#ifndef TROCAR_IGTL

bool igtl_is_built() { return false; }
bool read_igtl_message(std::span<const std::byte>, DeviceState&) { return false; }
std::unique_ptr<DeviceLink> open_igtl_device(const std::string& specification, const NetworkAddress&) {
    refuse_device(specification, "this program was built without OpenIGTLink");
}

#else

namespace {

constexpr size_t kHeader = 58, kLongestBody = 64 * 1024;     // bytes
constexpr int64_t kRetry = 500'000'000, kStep = 10'000'000;  // ns
constexpr int kTimeout = 10;                                 // ms, timeout of one wait
constexpr double kVelocityFilter = 5e-3;                     // s

uint64_t body_size(std::span<const std::byte> header) {
    uint64_t size = 0;
    for (size_t k = 42; k < 50; ++k) size = size << 8 | static_cast<uint64_t>(header[k]);
    return size;
}

// Fills a message of the library from memory and checks it. The caller has verified that the body has the
// length that the library expects for this type.
template <typename Message>
typename Message::Pointer unpack(igtl::MessageHeader* header, std::span<const std::byte> body) {
    typename Message::Pointer message = Message::New();
    message->SetMessageHeader(header);
    message->AllocatePack();
    if (message->GetPackBodySize() != static_cast<int>(body.size())) return nullptr;
    std::memcpy(message->GetPackBodyPointer(), body.data(), body.size());
    constexpr int kCheck = 1;
    return message->Unpack(kCheck) & igtl::MessageHeader::UNPACK_BODY ? message : typename Message::Pointer();
}

// From a rotation matrix (Shepperd, J. Guidance and Control 1(3), 1978); false if it is not one.
bool to_quaternion(const igtl::Matrix4x4& m, Quat& q) {
    Eigen::Matrix3d r;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) r(i, j) = static_cast<double>(m[i][j]);
    if (!r.allFinite() || !((r * r.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3) || r.determinant() < 0) return false;
    const Eigen::Quaterniond turn(r);
    q = normalized({turn.w(), turn.x(), turn.y(), turn.z()});
    return true;
}

// Velocity estimated from the positions of TRANSFORM and POSITION messages.
struct Motion {
    bool known = false;
    Vec3d position = Vec3d::Zero(), velocity = Vec3d::Zero();
    double time = 0;
    void add(DeviceState& state, double now) {
        const double elapsed = now - time;
        if (known && elapsed > 1e-5 && elapsed < 0.1)
            velocity += -std::expm1(-elapsed / kVelocityFilter) * ((state.position - position) / elapsed - velocity);
        else if (elapsed >= 0.1)
            velocity.setZero();
        known = true;
        position = state.position;
        time = now;
        state.time = now;
        state.velocity = velocity;
    }
};

void send_force(igtl::ClientSocket* socket, DeviceChannel& link) {
    bool fresh = false;
    const DeviceCommand command = link.command(monotonic_ns(), fresh);
    igtl::SensorMessage::Pointer message = igtl::SensorMessage::New();
    message->SetDeviceName("TrocarForce");
    message->SetLength(6);
    for (int k = 0; k < 3; ++k) message->SetValue(k, command.force[k]), message->SetValue(3 + k, command.torque[k]);
    message->Pack();
    if (socket->Send(message->GetPackPointer(), message->GetPackSize())) link.count(DeviceCount::kSent);
}

// Reads one message; false if the connection must be closed.
bool take_message(igtl::ClientSocket* socket, DeviceChannel& link, std::vector<std::byte>& bytes, Motion& motion) {
    bytes.resize(kHeader);
    const int got = socket->Receive(bytes.data(), kHeader);
    if (got < 0) return true;  // nothing in time
    if (got != kHeader) return false;
    link.count(DeviceCount::kReceived);
    const uint64_t size = body_size(bytes);
    if (size > kLongestBody) {
        link.count(DeviceCount::kOversized);
        return false;
    }
    bytes.resize(kHeader + size);
    if (size > 0 && socket->Receive(bytes.data() + kHeader, static_cast<int>(size)) != static_cast<int>(size)) {
        link.count(DeviceCount::kMalformed);
        return false;
    }
    DeviceState state;
    if (!read_igtl_message(bytes, state)) {
        link.count(DeviceCount::kMalformed);
        return true;
    }
    const int64_t now = monotonic_ns();
    motion.add(state, static_cast<double>(now) * 1e-9);
    link.publish(state, now);
    send_force(socket, link);
    return true;
}

void serve(DeviceChannel& link, const NetworkAddress& address) {
    std::vector<std::byte> bytes;
    bool connected_before = false;
    while (!link.stopping()) {
        igtl::ClientSocket::Pointer socket = igtl::ClientSocket::New();
        if (socket->ConnectToServer(address.host.c_str(), address.port) == 0) {
            if (connected_before) link.count(DeviceCount::kReconnected);
            connected_before = true;
            socket->SetReceiveTimeout(kTimeout);
            Motion motion;
            while (!link.stopping() && socket->GetConnected() && take_message(socket, link, bytes, motion)) {
            }
            socket->CloseSocket();
        }
        for (int64_t waited = 0; waited < kRetry && !link.stopping(); waited += kStep) sleep_until_ns(monotonic_ns() + kStep);
    }
}

}  // namespace

bool igtl_is_built() { return true; }

bool read_igtl_message(std::span<const std::byte> message, DeviceState& state) {
    if (message.size() < kHeader || body_size(message) != message.size() - kHeader) return false;
    igtl::MessageHeader::Pointer header = igtl::MessageHeader::New();
    header->InitPack();
    std::memcpy(header->GetPackPointer(), message.data(), kHeader);
    header->Unpack();
    const std::span<const std::byte> body = message.subspan(kHeader);
    DeviceState found;
    constexpr double kMillimetre = 1e-3;
    if (std::strcmp(header->GetDeviceType(), "TRANSFORM") == 0 && body.size() == 48) {
        const auto transform = unpack<igtl::TransformMessage>(header, body);
        if (!transform) return false;
        igtl::Matrix4x4 m;
        transform->GetMatrix(m);
        if (!to_quaternion(m, found.orientation)) return false;
        for (int k = 0; k < 3; ++k) found.position[k] = kMillimetre * static_cast<double>(m[k][3]);
    } else if (std::strcmp(header->GetDeviceType(), "POSITION") == 0 && (body.size() == 12 || body.size() == 28)) {
        const auto address = unpack<igtl::PositionMessage>(header, body);
        if (!address) return false;
        float x[3], q[4] = {0, 0, 0, 1};
        address->GetPosition(x);
        if (body.size() == 28) address->GetQuaternion(q);
        for (int k = 0; k < 3; ++k) found.position[k] = kMillimetre * static_cast<double>(x[k]);
        found.orientation = {static_cast<double>(q[3]), static_cast<double>(q[0]), static_cast<double>(q[1]), static_cast<double>(q[2])};
    } else {
        return false;
    }
    if (!is_sound(found)) return false;
    state = found;
    return true;
}

std::unique_ptr<DeviceLink> open_igtl_device(const std::string&, const NetworkAddress& address) {
    return std::make_unique<DeviceLink>("OpenIGTLink server at " + address.host + ":" + std::to_string(address.port),
                                        [address](DeviceChannel& link) { serve(link, address); });
}

#endif

}  // namespace trocar
