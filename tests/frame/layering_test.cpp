#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <string>
#include <vector>

// The include rule of README: components <- engine <- systems <- systems/app; content may include components and
// engine; a system includes no other system. Breaks when an #include points the wrong way, or when a third-party
// library is named in a second place.
namespace {
namespace fs = std::filesystem;

struct Include {
    std::string file;  // from the root
    std::string target;
    bool quoted;
};

std::vector<Include> includes_below(const std::string& folder) {
    std::vector<Include> found;
    const fs::path root = TROCAR_SOURCE_DIR;
    const std::regex pattern(R"re(^\s*#\s*include\s*(["<])([^">]+)[">])re");
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root / folder)) {
        if (entry.path().extension() != ".hpp" && entry.path().extension() != ".cpp") continue;
        std::ifstream stream(entry.path());
        std::string line;
        while (std::getline(stream, line)) {
            std::smatch match;
            if (std::regex_search(line, match, pattern))
                found.push_back({fs::relative(entry.path(), root).string(), match[2], match[1] == "\""});
        }
    }
    return found;
}

bool starts_with(const std::string& text, const std::string& head) { return text.rfind(head, 0) == 0; }

// "systems/advance_rows.hpp" -> "advance": files that share a system's name belong to it.
std::string stem(const std::string& file) { return fs::path(file).stem().string(); }

bool same_system(const std::string& includer, const std::string& target) {
    const std::string a = stem(includer), b = stem(target);
    return starts_with(a, b) || starts_with(b, a) || a.substr(0, a.find('_')) == b.substr(0, b.find('_'));
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
        EXPECT_TRUE(starts_with(i.target, "components/") || starts_with(i.target, "engine/"))
                << i.file << " includes " << i.target;
    }
}

TEST(Layering, ContentIncludesOnlyComponentsEngineAndContent) {
    for (const Include& i : includes_below("content")) {
        if (!i.quoted) continue;
        EXPECT_TRUE(starts_with(i.target, "components/") || starts_with(i.target, "engine/") ||
                        starts_with(i.target, "content/"))
                << i.file << " includes " << i.target;
    }
}

TEST(Layering, SystemsDoNotIncludeEachOther) {
    for (const Include& i : includes_below("systems")) {
        if (!i.quoted || starts_with(i.file, "systems/app/") || starts_with(i.file, "systems/frame")) continue;
        EXPECT_FALSE(starts_with(i.target, "content/") || starts_with(i.target, "systems/app/"))
            << i.file << " includes " << i.target;
        const bool fine = !starts_with(i.target, "systems/") || same_system(i.file, i.target);
        EXPECT_TRUE(fine) << i.file << " includes " << i.target;
    }
}

TEST(Layering, ThirdPartyLibrariesAreNamedInOnePlace) {
    const std::vector<std::pair<std::string, std::vector<std::string>>> allowed = {
        {"embree3/", {"engine/closest_point"}},
        {"tbb/", {"engine/job_graph.cpp", "engine/parallel.cpp", "engine/thread_pool.cpp"}},
        {"GL/", {"engine/offscreen", "engine/gl_"}},
        {"png.h", {"engine/image_file.cpp"}},
        {"jpeglib.h", {"engine/image_file.cpp"}},
        {"gif_lib.h", {"engine/image_file.cpp"}},
        {"zlib.h", {"engine/text_file.cpp", "engine/image_file.cpp"}},
        {"toml++/", {"content/scene_file.cpp"}},
        {"meshoptimizer", {"content/"}},
        {"CLI/", {"systems/app/main.cpp"}},
        {"nlohmann/", {"systems/app/"}},
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

}  // namespace
