#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "reference/paths.hpp"

// The rooms of README: the folders and which of them may include which. Breaks when an #include has no entry
// in the table, when an entry is not used, when entries form a cycle, or when a third-party library is named
// twice.
namespace {
namespace fs = std::filesystem;

struct Include {
    std::string file;  // from the root
    std::string target;
    bool quoted = false;
};

// The part of an #include line between its quotes or angle brackets; empty for any other line.
Include parse_include(const std::string& line) {
    const size_t hash = line.find_first_not_of(" \t");
    if (hash == std::string::npos || line[hash] != '#') return {};
    const size_t word = line.find_first_not_of(" \t", hash + 1);
    if (word == std::string::npos || line.compare(word, 7, "include") != 0) return {};
    const size_t open = line.find_first_of("\"<", word);
    if (open == std::string::npos) return {};
    const size_t close = line.find_first_of("\">", open + 1);
    if (close == std::string::npos) return {};
    return {"", line.substr(open + 1, close - open - 1), line[open] == '"'};
}

std::vector<Include> includes_below(const std::string& folder) {
    std::vector<Include> found;
    const fs::path root = trocar::source_folder();
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root / folder)) {
        const fs::path ending = entry.path().extension();
        if (ending != ".hpp" && ending != ".cpp" && ending != ".inl" && ending != ".h") continue;
        std::ifstream stream(entry.path());
        for (std::string line; std::getline(stream, line);) {
            Include include = parse_include(line);
            if (include.target.empty()) continue;
            include.file = fs::relative(entry.path(), root).string();
            found.push_back(include);
        }
    }
    EXPECT_FALSE(found.empty()) << folder;
    return found;
}

bool starts_with(const std::string& text, const std::string& head) { return text.rfind(head, 0) == 0; }

constexpr const char* kFolders[] = {"components", "engine", "systems", "content"};

// Room -> rooms that it may include, from the table of README.
using Rooms = std::map<std::string, std::set<std::string>>;

// A cell of the table's last column: "engine: base jobs; content: read". Rooms of systems/app may include all
// rooms below it.
std::set<std::string> parse_allowed(const std::string& room, const std::string& cell) {
    std::set<std::string> allowed{"components"};
    std::istringstream groups(cell);
    for (std::string group; std::getline(groups, group, ';');) {
        const size_t colon = group.find(':');
        if (colon == std::string::npos) continue;  // "everything below"
        std::istringstream words(group.substr(0, colon));
        std::string folder, name;
        words >> folder;
        std::istringstream names(group.substr(colon + 1));
        while (names >> name) allowed.insert(folder + "/" + name);
    }
    allowed.erase(room);
    return allowed;
}

Rooms read_rooms() {
    Rooms rooms;
    std::ifstream readme(fs::path(trocar::source_folder()) / "README.md");
    for (std::string line; std::getline(readme, line);) {
        std::vector<std::string> cells;
        std::istringstream stream(line);
        for (std::string cell; std::getline(stream, cell, '|');) cells.push_back(cell);
        if (cells.size() < 4 || !starts_with(cells[1], " `")) continue;
        const std::string room = cells[1].substr(2, cells[1].find('`', 2) - 2);
        for (const char* folder : kFolders)
            if (room == folder || starts_with(room, folder + std::string("/"))) rooms[room] = parse_allowed(room, cells[3]);
    }
    EXPECT_GT(rooms.size(), 30u);
    return rooms;
}

// The room of a file: the longest one that its path begins with. Empty if there is none.
std::string room_of(const Rooms& rooms, const std::string& file) {
    std::string best;
    for (const auto& [room, allowed] : rooms)
        if (starts_with(file, room + "/") && room.size() > best.size()) best = room;
    return best;
}

bool is_app(const std::string& room) { return starts_with(room, "systems/app/"); }

TEST(Layering, EveryIncludeIsAnArrowOfTheTableOfRooms) {
    const Rooms rooms = read_rooms();
    std::set<std::pair<std::string, std::string>> used;
    for (const char* folder : kFolders) {
        for (const Include& i : includes_below(folder)) {
            const std::string from = room_of(rooms, i.file), to = room_of(rooms, i.target);
            EXPECT_NE(from, "") << i.file << " lies in no room of README.md";
            if (!i.quoted) continue;
            EXPECT_NE(to, "") << i.file << " includes " << i.target << ", which lies in no room of README.md";
            if (from == to || (is_app(from) && !is_app(to))) continue;
            used.insert({from, to});
            EXPECT_TRUE(rooms.at(from).contains(to)) << i.file << " includes " << i.target << ": README.md has no arrow from " << from;
        }
    }
    for (const auto& [room, allowed] : rooms)
        for (const std::string& to : allowed)
            EXPECT_TRUE(to == "components" || used.contains({room, to}))
                << "README.md lets " << room << " include " << to << ": nothing does";
}

TEST(Layering, TheTableOfRoomsHasNoCycle) {
    Rooms rooms = read_rooms();
    while (!rooms.empty()) {
        const auto open = [&](const std::string& to) { return rooms.contains(to); };
        const auto free = std::ranges::find_if(rooms, [&](const auto& room) { return std::ranges::none_of(room.second, open); });
        if (free == rooms.end()) {
            for (const auto& [room, allowed] : rooms) ADD_FAILURE() << room << " is part of a cycle or above one";
            return;
        }
        rooms.erase(free);
    }
}

TEST(Layering, ComponentsIncludeOnlyComponentsStdAndEigen) {
    for (const Include& i : includes_below("components")) {
        const bool fine = i.quoted ? starts_with(i.target, "components/")
                                   : starts_with(i.target, "Eigen/Core") || i.target.find('/') == std::string::npos;
        EXPECT_TRUE(fine) << i.file << " includes " << i.target;
    }
}

TEST(Layering, ThirdPartyLibrariesAreNamedInOnePlace) {
    const std::vector<std::pair<std::string, std::vector<std::string>>> allowed = {
        {"embree3/", {"engine/distance/embree_device.hpp"}},
        {"tbb/", {"engine/jobs/job_graph.cpp", "engine/jobs/parallel.cpp", "engine/jobs/thread_pool.cpp"}},
        {"GL/", {"engine/draw/offscreen", "engine/draw/gl_"}},
        {"png.h", {"engine/files/image_file.cpp"}},
        {"jpeglib.h", {"engine/files/image_file.cpp"}},
        {"gif_lib.h", {"engine/files/image_file.cpp"}},
        {"zlib.h", {"engine/files/text_file.cpp", "engine/files/image_file.cpp", "content/read/helpers/volume_reader.cpp", "systems/app/station/mcap.cpp"}},
        {"itk", {"content/read/helpers/volume_reader.cpp"}},
        {"toml++/", {"content/scene/toml_section.cpp", "content/scene/toml_section.hpp"}},
        {"meshoptimizer", {"content/volume/organ_surface.cpp"}},
        {"assimp/", {"content/read/helpers/assimp_reader.cpp"}},
        {"pugixml", {"content/read/vrml/x3d.cpp", "content/read/vtp_file.cpp"}},
        {"CLI/", {"systems/app/commands/main.cpp"}},
        {"nlohmann/", {"systems/app/", "engine/devices/haply.cpp"}},
        {"libwebsockets", {"engine/devices/haply.cpp", "systems/app/view/view_server.cpp"}},
        {"igtl", {"engine/devices/igtl.cpp"}},
    };
    for (const char* folder : {"components", "engine", "content", "systems"}) {
        for (const Include& i : includes_below(folder)) {
            if (i.quoted) continue;
            for (const auto& [library, positions] : allowed) {
                if (!starts_with(i.target, library)) continue;
                bool fine = false;
                for (const std::string& position : positions) fine = fine || starts_with(i.file, position);
                EXPECT_TRUE(fine) << i.file << " includes <" << i.target << ">";
            }
        }
    }
}

// Every hard case of contact, haptics and long runs has a test with its number in the name, so that a failure
// identifies it: G closest point and sign, P pairs and depth, H the grid, T touch, S long runs.
TEST(HardCases, EveryCaseHasATestOfItsName) {
    std::string names;
    const fs::path root = trocar::source_folder();
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root / "tests")) {
        if (entry.path().extension() != ".cpp") continue;
        std::ifstream stream(entry.path());
        for (std::string line; std::getline(stream, line);) {
            if (starts_with(line, "TEST")) names += "_" + line.substr(line.find(", ") + 2, line.find(')') - line.find(", ") - 2) + "_\n";
        }
    }
    for (const auto& [letter, count] : {std::pair{'G', 37}, {'P', 28}, {'H', 20}, {'T', 19}, {'S', 11}}) {
        for (int i = 1; i <= count; ++i) {
            const std::string id = letter + std::string(i < 10 ? "0" : "") + std::to_string(i);
            EXPECT_NE(names.find("_" + id), std::string::npos) << id << " has no test";
        }
    }
}

// The member function called at the parenthesis `at`, without its template arguments; empty if there is none.
std::string member_before(const std::string& source, size_t at) {
    if (at > 0 && source[at - 1] == '>') at = source.rfind('<', at);
    size_t first = at;
    while (first > 0 && (std::isalpha(static_cast<unsigned char>(source[first - 1])) || source[first - 1] == '_')) --first;
    return first > 0 && source[first - 1] == '.' ? source.substr(first, at - first) : "";
}

// Breaks when a scene key is missing from its reference.
TEST(Documents, EveryKeyOfAScene) {
    const fs::path root = trocar::source_folder();
    std::stringstream reference;
    reference << std::ifstream(root / "docs/scenes.md").rdbuf();
    const std::string text = reference.str();
    size_t keys = 0;
    for (const fs::directory_entry& entry : fs::directory_iterator(root / "content/scene")) {
        if (entry.path().extension() != ".cpp") continue;
        std::stringstream stream;
        stream << std::ifstream(entry.path()).rdbuf();
        const std::string source = stream.str();
        if (source.find("TomlSection") == std::string::npos) continue;
        for (size_t at = 0; (at = source.find("(\"", at)) != std::string::npos; at += 2) {
            const std::string caller = member_before(source, at), key = source.substr(at + 2, source.find('"', at + 2) - at - 2);
            if (!starts_with(caller, "read") && caller != "table" && caller != "tables" && caller != "find") continue;
            ++keys;
            EXPECT_NE(text.find("`" + key + "`"), std::string::npos)
                << entry.path() << " reads " << key << ", docs/scenes.md does not say so";
        }
    }
    EXPECT_GT(keys, 150u);
}

}  // namespace
