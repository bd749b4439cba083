#include "systems/app/video.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "engine/image_file.hpp"

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

// every picture is there, in order, the right way up, with its colours (within what 4:2:0 and the encoder lose)
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

TEST_F(Video, HoldsEveryPictureInOrder) {
    const fs::path file = folder.path / "film of 1.mp4";
    VideoWriter video(file, 128, 64, 30);
    for (uint32_t n = 0; n < 12; ++n) ASSERT_TRUE(video.add(moving_bar(128, 64, n))) << video.error();
    EXPECT_FALSE(fs::exists(file));  // nothing under the final name before it is whole
    ASSERT_TRUE(video.finish()) << video.error();
    EXPECT_EQ(folder.files(), 1u);
    expect_bars(file, 128, 64, 12);
}

TEST_F(Video, TakesOddSizes) {
    const fs::path file = folder.path / "odd.mp4";
    VideoWriter video(file, 127, 33, 30);
    for (uint32_t n = 0; n < 3; ++n) ASSERT_TRUE(video.add(moving_bar(127, 33, n)));
    ASSERT_TRUE(video.finish()) << video.error();
    expect_bars(file, 128, 34, 3);
}

TEST_F(Video, IsMadeFromNumberedPictures) {
    for (uint32_t n = 0; n < 5; ++n) {
        char name[32];
        std::snprintf(name, sizeof name, "frame_%04u.png", n + 7);
        save_png(moving_bar(128, 64, n), folder.path / name);
    }
    std::string error = "unset";
    ASSERT_TRUE(write_video(folder.path / "frame_%04d.png", 7, 30, folder.path / "film.mp4", error)) << error;
    EXPECT_EQ(error, "");
    expect_bars(folder.path / "film.mp4", 128, 64, 5);
    EXPECT_EQ(folder.files(), 6u);
}

TEST_F(Video, LeavesNothingBehindWhenItIsNotFinished) {
    {
        VideoWriter video(folder.path / "film.mp4", 64, 64, 30);
        for (uint32_t n = 0; n < 5; ++n) ASSERT_TRUE(video.add(moving_bar(64, 64, n)));
    }
    EXPECT_EQ(folder.files(), 0u);
}

// Ctrl-C goes to everybody in the terminal's foreground group. Who writes the film stops when he likes; it must be whole
TEST_F(Video, SurvivesCtrlC) {
    const fs::path file = folder.path / "film.mp4";
    const pid_t writer = fork();
    if (writer == 0) {
        setpgid(0, 0);
        signal(SIGINT, [](int) {});
        VideoWriter video(file, 64, 64, 30);
        bool good = true;
        for (uint32_t n = 0; n < 6; ++n) {
            good = good && video.add(moving_bar(64, 64, n));
            if (n == 2) kill(0, SIGINT), usleep(100'000);
        }
        _exit(good && video.finish() ? 0 : 1);
    }
    int status = 1;
    ASSERT_EQ(waitpid(writer, &status, 0), writer);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    expect_bars(file, 64, 64, 6);
}

void expect_one_line(const std::string& error, const std::string& file) {
    EXPECT_TRUE(error.starts_with(file + ": ")) << error;
    EXPECT_EQ(error.find('\n'), std::string::npos) << error;
    EXPECT_GT(error.size(), file.size() + 5);
}

TEST_F(Video, SaysInOneLineWhyItFailed) {
    const fs::path nowhere = folder.path / "missing" / "film.mp4";
    VideoWriter video(nowhere, 64, 64, 30);
    for (uint32_t n = 0; n < 100 && video.add(moving_bar(64, 64, n)); ++n) continue;
    EXPECT_FALSE(video.finish());
    expect_one_line(video.error(), nowhere.string());
    EXPECT_FALSE(video.add(moving_bar(64, 64, 0)));

    VideoWriter other(folder.path / "size.mp4", 64, 64, 30);
    EXPECT_FALSE(other.add(moving_bar(64, 32, 0)));
    expect_one_line(other.error(), (folder.path / "size.mp4").string());

    std::string error;
    EXPECT_FALSE(write_video(folder.path / "none_%04d.png", 0, 30, folder.path / "film.mp4", error));
    expect_one_line(error, (folder.path / "film.mp4").string());
}

// without the program: no crash, no signal, a clear word
TEST(VideoWithout, Ffmpeg) {
    const char* path = std::getenv("PATH");
    const std::string kept = path ? path : "";
    Folder folder;
    setenv("PATH", folder.path.c_str(), 1);
    EXPECT_FALSE(ffmpeg_present());
    const fs::path file = folder.path / "film.mp4";
    VideoWriter video(file, 64, 64, 30);
    EXPECT_FALSE(video.add(moving_bar(64, 64, 0)));
    EXPECT_FALSE(video.finish());
    EXPECT_EQ(video.error(), file.string() + ": the program ffmpeg is not on PATH");
    std::string error;
    EXPECT_FALSE(write_video(folder.path / "%d.png", 0, 30, file, error));
    EXPECT_EQ(error, file.string() + ": the program ffmpeg is not on PATH");
    setenv("PATH", kept.c_str(), 1);
}

}  // namespace
}  // namespace trocar
