#include <gtest/gtest.h>

#include <cctype>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "reference/paths.hpp"

// The include rule of README: components <- engine <- systems <- systems/app; content may include components and
// engine; a system includes no other system. Breaks when an #include points the wrong way, or when a third-party
// library is named in a second place.
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
        if (entry.path().extension() != ".hpp" && entry.path().extension() != ".cpp") continue;
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

std::string stem(const std::string& file) { return fs::path(file).stem().string(); }

bool same_system(const std::string& includer, const std::string& target) {
    const std::string a = stem(includer), b = stem(target);
    for (const char* system : {"advance", "haptic"})  // of several files each
        if (starts_with(a, system) && starts_with(b, system)) return true;
    return a == b;
}

TEST(Layering, ComponentsIncludeOnlyComponentsStdAndEigen) {
    for (const Include& i : includes_below("components")) {
        const bool fine = i.quoted ? starts_with(i.target, "components/")
                                   : starts_with(i.target, "Eigen/Core") || i.target.find('/') == std::string::npos;
        EXPECT_TRUE(fine) << i.file << " includes " << i.target;
    }
}

TEST(Layering, EngineIncludesOnlyComponentsAndEngine) {
    for (const Include& i : includes_below("engine")) {
        if (!i.quoted) continue;
        EXPECT_TRUE(starts_with(i.target, "components/") || starts_with(i.target, "engine/")) << i.file << " includes " << i.target;
    }
}

TEST(Layering, ContentIncludesOnlyComponentsEngineAndContent) {
    for (const Include& i : includes_below("content")) {
        if (!i.quoted) continue;
        EXPECT_TRUE(starts_with(i.target, "components/") || starts_with(i.target, "engine/") || starts_with(i.target, "content/"))
            << i.file << " includes " << i.target;
    }
}

TEST(Layering, SystemsDoNotIncludeEachOther) {
    for (const Include& i : includes_below("systems")) {
        if (!i.quoted || starts_with(i.file, "systems/app/") || starts_with(i.file, "systems/frame")) continue;
        EXPECT_FALSE(starts_with(i.target, "content/") || starts_with(i.target, "systems/app/")) << i.file << " includes " << i.target;
        const bool fine = !starts_with(i.target, "systems/") || same_system(i.file, i.target);
        EXPECT_TRUE(fine) << i.file << " includes " << i.target;
    }
}

TEST(Layering, ThirdPartyLibrariesAreNamedInOnePlace) {
    const std::vector<std::pair<std::string, std::vector<std::string>>> allowed = {
        {"embree3/", {"engine/embree_device.hpp"}},
        {"tbb/", {"engine/job_graph.cpp", "engine/parallel.cpp", "engine/thread_pool.cpp"}},
        {"GL/", {"engine/offscreen", "engine/gl_"}},
        {"png.h", {"engine/image_file.cpp"}},
        {"jpeglib.h", {"engine/image_file.cpp"}},
        {"gif_lib.h", {"engine/image_file.cpp"}},
        {"zlib.h", {"engine/text_file.cpp", "engine/image_file.cpp", "content/helpers/volume_reader.cpp"}},
        {"itk", {"content/helpers/volume_reader.cpp"}},
        {"toml++/", {"content/toml_section.cpp", "content/toml_section.hpp"}},
        {"meshoptimizer", {"content/"}},
        {"assimp/", {"content/helpers/assimp_reader.cpp"}},
        {"pugixml", {"content/vrml/x3d.cpp"}},
        {"CLI/", {"systems/app/main.cpp"}},
        {"nlohmann/", {"systems/app/", "engine/device_haply.cpp"}},
        {"libwebsockets", {"engine/device_haply.cpp"}},
        {"igtl", {"engine/device_igtl.cpp"}},
    };
    for (const char* folder : {"components", "engine", "content", "systems"}) {
        for (const Include& i : includes_below(folder)) {
            if (i.quoted) continue;
            for (const auto& [library, places] : allowed) {
                if (!starts_with(i.target, library)) continue;
                bool fine = false;
                for (const std::string& place : places) fine = fine || starts_with(i.file, place);
                EXPECT_TRUE(fine) << i.file << " includes <" << i.target << ">";
            }
        }
    }
}

// Every hard case of contact, of haptics and of long runs has a test, whose name, and so its failure, says which: G closest point and
// sign, P pairs and depth, H the grid, T touch, S long runs.
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

// The member function that is called at the parenthesis `at`, without its template arguments; empty where there is none.
std::string member_before(const std::string& source, size_t at) {
    if (at > 0 && source[at - 1] == '>') at = source.rfind('<', at);
    size_t first = at;
    while (first > 0 && (std::isalpha(static_cast<unsigned char>(source[first - 1])) || source[first - 1] == '_')) --first;
    return first > 0 && source[first - 1] == '.' ? source.substr(first, at - first) : "";
}

// Breaks when a key that scenes may have is not in their reference.
TEST(Documents, EveryKeyOfAScene) {
    const fs::path root = trocar::source_folder();
    std::stringstream reference;
    reference << std::ifstream(root / "docs/scenes.md").rdbuf();
    const std::string text = reference.str();
    size_t keys = 0;
    for (const fs::directory_entry& entry : fs::directory_iterator(root / "content")) {
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
