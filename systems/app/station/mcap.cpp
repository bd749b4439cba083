#include "systems/app/station/mcap.hpp"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "systems/app/console/version.hpp"
namespace trocar {
namespace {

using json = nlohmann::ordered_json;

// Little-endian bytes of one record's content.
struct Bytes {
    std::string text;
    template <typename Number>
    Bytes& put(Number value) {
        for (size_t k = 0; k < sizeof value; ++k) text += static_cast<char>(static_cast<uint64_t>(value) >> (8 * k) & 0xff);
        return *this;
    }
    Bytes& put_string(const std::string& s) {
        put(static_cast<uint32_t>(s.size()));
        text += s;
        return *this;
    }
    // A map or array: its length in bytes, then its elements.
    Bytes& put_block(const Bytes& elements) {
        put(static_cast<uint32_t>(elements.text.size()));
        text += elements.text;
        return *this;
    }
};

enum Opcode : uint8_t {
    kHeader = 1,
    kFooter,
    kSchema,
    kChannel,
    kMessage,
    kChunk,
    kMessageIndex,
    kChunkIndex,
    kStatistics = 0x0b,
    kMetadata,
    kMetadataIndex,
    kSummaryOffset,
    kDataEnd
};

constexpr char kMcapMagic[] = "\x89MCAP0\r\n";
constexpr size_t kChunkBytes = size_t{1} << 20;

std::string record(Opcode opcode, const Bytes& content) {
    Bytes out;
    out.put(static_cast<uint8_t>(opcode)).put(static_cast<uint64_t>(content.text.size()));
    return out.text + content.text;
}

uint32_t checksum(const std::string& bytes) {
    return static_cast<uint32_t>(crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
}

uint64_t nanoseconds(double seconds) { return static_cast<uint64_t>(std::llround(std::max(0.0, seconds) * 1e9)); }

struct Message {
    uint64_t time = 0;
    uint16_t channel = 0;
    uint32_t sequence = 0;
    std::string data;
};

json vector_json(const Vec3d& v) { return {{"x", v.x()}, {"y", v.y()}, {"z", v.z()}}; }

std::string sample_json(const Exercise& e, const ExerciseSample& s) {
    json j = {{"time_s", s.time},
              {"tip_m", vector_json(s.tip)},
              {"orientation", {{"w", s.turn.w}, {"x", s.turn.x}, {"y", s.turn.y}, {"z", s.turn.z}}},
              {"proxy_m", vector_json(s.proxy)},
              {"grip_rad", s.grip},
              {"buttons", s.buttons},
              {"hand_n", vector_json(s.hand)},
              {"hand_peak_n", s.hand_peak},
              {"torque_nm", vector_json(s.torque)},
              {"tissue_n", vector_json(s.tissue)},
              {"contacts", s.contacts},
              {"organs_n", json::object()}};
    for (uint32_t k = s.organs.first; k < s.organs.end(); ++k) j["organs_n"][e.organ[e.organ_force[k].organ]] = e.organ_force[k].force;
    return j.dump();
}

std::string schema_json(const char* title, std::initializer_list<std::pair<const char*, const char*>> properties) {
    json j = {{"title", title}, {"type", "object"}, {"properties", json::object()}};
    const json number = {{"type", "number"}};
    for (const auto& [name, kind] : properties) {
        const std::string k = kind;
        if (k == "vector" || k == "quaternion") {
            json axes = json::object();
            for (const char* axis : {"w", "x", "y", "z"})
                if (*axis != 'w' || k == "quaternion") axes[axis] = number;
            j["properties"][name] = {{"type", "object"}, {"properties", axes}};
        } else if (k == "map") {
            j["properties"][name] = {{"type", "object"}, {"additionalProperties", number}};
        } else {
            j["properties"][name] = {{"type", k}};
        }
    }
    return j.dump();
}

std::vector<Message> messages_of(const Exercise& e) {
    std::vector<Message> all;
    std::map<uint16_t, uint32_t> count;
    for (const ExerciseSample& s : e.sample) all.push_back({nanoseconds(s.time), static_cast<uint16_t>(s.tool + 1), 0, sample_json(e, s)});
    for (const ExerciseEvent& event : e.event) {
        json j = {{"time_s", event.time},
                  {"event", event.kind},
                  {"tool", event.tool == kNone ? "" : e.tool[event.tool]},
                  {"object", event.object}};
        all.push_back({nanoseconds(event.time), 0, 0, j.dump()});
    }
    std::ranges::stable_sort(all, {}, &Message::time);
    for (Message& m : all) m.sequence = count[m.channel]++;
    return all;
}

}  // namespace

std::string exercise_mcap(const Exercise& e) {
    // schemas and channels, once before the chunks and again in the summary
    std::string schemas, channels;
    const auto add_schema = [&](uint16_t id, const char* name, const std::string& text) {
        schemas += record(kSchema, Bytes().put(id).put_string(name).put_string("jsonschema").put_string(text));
    };
    add_schema(1, "trocar.ExerciseEvent",
               schema_json("trocar.ExerciseEvent", {{"time_s", "number"}, {"event", "string"}, {"tool", "string"}, {"object", "string"}}));
    add_schema(2, "trocar.ExerciseSample",
               schema_json("trocar.ExerciseSample", {{"time_s", "number"},
                                                     {"tip_m", "vector"},
                                                     {"orientation", "quaternion"},
                                                     {"proxy_m", "vector"},
                                                     {"grip_rad", "number"},
                                                     {"buttons", "integer"},
                                                     {"hand_n", "vector"},
                                                     {"hand_peak_n", "number"},
                                                     {"torque_nm", "vector"},
                                                     {"tissue_n", "vector"},
                                                     {"contacts", "integer"},
                                                     {"organs_n", "map"}}));
    const auto add_channel = [&](uint16_t id, uint16_t schema, const std::string& topic) {
        channels += record(kChannel, Bytes().put(id).put(schema).put_string(topic).put_string("json").put_block({}));
    };
    add_channel(0, 1, "/events");
    for (size_t t = 0; t < e.tool.size(); ++t) add_channel(static_cast<uint16_t>(t + 1), 2, "/tool/" + e.tool[t]);
    const std::vector<Message> messages = messages_of(e);

    std::string out(kMcapMagic, 8), indices;
    out += record(kHeader, Bytes().put_string("").put_string("trocar " + std::string(program_version())));
    out += schemas + channels;
    uint32_t chunks = 0;
    std::map<uint16_t, uint64_t> per_channel;
    for (size_t first = 0; first < messages.size();) {
        std::string inside;
        std::map<uint16_t, Bytes> index;
        size_t last = first;
        for (; last < messages.size() && inside.size() < kChunkBytes; ++last) {
            const Message& m = messages[last];
            index[m.channel].put(m.time).put(static_cast<uint64_t>(inside.size()));
            Bytes message;
            message.put(m.channel).put(m.sequence).put(m.time).put(m.time).text += m.data;
            inside += record(kMessage, message), ++per_channel[m.channel];
        }
        Bytes chunk;
        chunk.put(messages[first].time).put(messages[last - 1].time).put(static_cast<uint64_t>(inside.size())).put(checksum(inside));
        chunk.put_string("").put(static_cast<uint64_t>(inside.size())).text += inside;
        const uint64_t start = out.size();
        out += record(kChunk, chunk);
        const uint64_t length = out.size() - start, first_index = out.size();
        Bytes offsets;
        for (const auto& [channel, entries] : index) {
            offsets.put(channel).put(static_cast<uint64_t>(out.size()));
            out += record(kMessageIndex, Bytes().put(channel).put_block(entries));
        }
        indices += record(kChunkIndex, Bytes()
                                           .put(messages[first].time)
                                           .put(messages[last - 1].time)
                                           .put(start)
                                           .put(length)
                                           .put_block(offsets)
                                           .put(static_cast<uint64_t>(out.size() - first_index))
                                           .put_string("")
                                           .put(static_cast<uint64_t>(inside.size()))
                                           .put(static_cast<uint64_t>(inside.size())));
        ++chunks, first = last;
    }
    out += record(kDataEnd, Bytes().put(checksum(out)));
    const uint64_t summary = out.size();
    Bytes counts;
    for (const auto& [channel, count] : per_channel) counts.put(channel).put(count);
    const std::string statistics = record(kStatistics, Bytes()
                                                           .put(static_cast<uint64_t>(messages.size()))
                                                           .put(uint16_t{2})
                                                           .put(static_cast<uint32_t>(e.tool.size() + 1))
                                                           .put(uint32_t{0})
                                                           .put(uint32_t{0})
                                                           .put(chunks)
                                                           .put(messages.empty() ? 0 : messages.front().time)
                                                           .put(messages.empty() ? 0 : messages.back().time)
                                                           .put_block(counts));
    out += schemas + channels + statistics + indices;
    Bytes footer;  // no summary offsets: readers find the groups by reading the summary
    footer.put(summary).put(uint64_t{0});
    std::string head;  // opcode and length are part of what is summed
    head += static_cast<char>(kFooter);
    Bytes length;
    length.put(uint64_t{20});
    const uint32_t sum = checksum(out.substr(summary) + head + length.text + footer.text);
    out += record(kFooter, footer.put(sum));
    return out + std::string(kMcapMagic, 8);
}

}  // namespace trocar
