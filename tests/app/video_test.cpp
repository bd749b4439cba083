#include "systems/app/pictures/video.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "engine/files/image_file.hpp"

namespace trocar {
namespace {

namespace fs = std::filesystem;

struct Folder {
    fs::path path;
    Folder() {
        std::string name = (fs::temp_directory_path() / "trocar_video_XXXXXX").string();
        path = mkdtemp(name.data());
    }
    ~Folder() { fs::remove_all(path); }
    size_t files() const { return static_cast<size_t>(std::distance(fs::directory_iterator(path), fs::directory_iterator())); }
};

// left part red, right part blue; the border moves with the picture's number
Image moving_bar(uint32_t width, uint32_t height, uint32_t number) {
    Image image{width, height, {}};
    for (uint32_t y = 0; y < height; ++y)
        for (uint32_t x = 0; x < width; ++x) {
            const bool left = x < 8 * (number + 1);
            image.rgba.insert(image.rgba.end(), {static_cast<uint8_t>(left ? 255 : 0), 0, static_cast<uint8_t>(left ? 0 : 255), 255});
        }
    return image;
}

// the video as raw RGB, decoded by ffmpeg
std::string decode(const fs::path& file) {
    const std::string command = "ffmpeg -v error -i '" + file.string() + "' -f rawvideo -pix_fmt rgb24 - 2>/dev/null";
    FILE* pipe = popen(command.c_str(), "r");
    std::string bytes;
    char part[65536];
    for (size_t got; (got = std::fread(part, 1, sizeof part, pipe)) > 0;) bytes.append(part, got);
    pclose(pipe);
    return bytes;
}

// every picture is there, in order, upright, with its colours (within the losses of 4:2:0 and the encoder)
void expect_bars(const fs::path& file, uint32_t width, uint32_t height, uint32_t count) {
    const std::string bytes = decode(file);
    ASSERT_EQ(bytes.size(), size_t{3} * width * height * count);
    for (uint32_t n = 0; n < count; ++n) {
        const auto channel = [&](uint32_t x, uint32_t c) {
            return int{static_cast<uint8_t>(bytes[3 * ((size_t{n} * height + height / 2) * width + x) + c])};
        };
        EXPECT_GT(channel(8 * n + 3, 0), 200);
        EXPECT_LT(channel(8 * n + 3, 2), 60);
        EXPECT_GT(channel(8 * n + 13, 2), 200);
        EXPECT_LT(channel(8 * n + 13, 0), 60);
    }
}

class Video : public testing::Test {
 protected:
    void SetUp() override {
        if (!ffmpeg_present()) GTEST_SKIP() << "the program ffmpeg is not on PATH";
    }
    Folder folder;
};

// Odd sides grow to even ones.
TEST_F(Video, HoldsEveryPictureInOrder) {
    for (const auto [width, height] : {std::array{128u, 64u}, std::array{127u, 33u}}) {
        for (uint32_t n = 0; n < 5; ++n) {
            char name[32];
            std::snprintf(name, sizeof name, "frame_%04u.png", n + 7);
            save_png(moving_bar(width, height, n), folder.path / name);
        }
        const fs::path file = folder.path / "film of 1.mp4";
        std::string error = "unset";
        ASSERT_TRUE(write_video(folder.path / "frame_%04d.png", 7, 30, file, error)) << error;
        EXPECT_EQ(error, "");
        expect_bars(file, 128, height + height % 2, 5);
        EXPECT_EQ(folder.files(), 6u);
    }
}

void expect_one_line(const std::string& error, const std::string& file) {
    EXPECT_TRUE(error.starts_with(file + ": ")) << error;
    EXPECT_EQ(error.find('\n'), std::string::npos) << error;
    EXPECT_GT(error.size(), file.size() + 5);
}

TEST_F(Video, SaysInOneLineWhyItFailed) {
    save_png(moving_bar(64, 64, 0), folder.path / "some_0000.png");
    std::string none;
    EXPECT_FALSE(write_video(folder.path / "some_%04d.png", 0, 30, folder.path / "missing" / "film.mp4", none));
    expect_one_line(none, (folder.path / "missing" / "film.mp4").string());
    std::string error;
    EXPECT_FALSE(write_video(folder.path / "none_%04d.png", 0, 30, folder.path / "film.mp4", error));
    expect_one_line(error, (folder.path / "film.mp4").string());
}

// without the program: no crash, no signal, a clear message
TEST(VideoWithout, Ffmpeg) {
    const char* path = std::getenv("PATH");
    const std::string kept = path ? path : "";
    Folder folder;
    setenv("PATH", folder.path.c_str(), 1);
    EXPECT_FALSE(ffmpeg_present());
    const fs::path file = folder.path / "film.mp4";
    std::string error;
    EXPECT_FALSE(write_video(folder.path / "%d.png", 0, 30, file, error));
    EXPECT_EQ(error, file.string() + ": the program ffmpeg is not on PATH");
    setenv("PATH", kept.c_str(), 1);
}

}  // namespace
}  // namespace trocar
