#include "engine/files/text_file.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "engine/base/error.hpp"
#include "reference/gzip.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

struct TextFile : testing::Test {
    fs::path folder = fs::temp_directory_path() / ("trocar_text_" + std::to_string(::getpid()));
    void SetUp() override { fs::create_directories(folder); }
    void TearDown() override { fs::remove_all(folder); }
    fs::path put(const std::string& name, const std::string& bytes) const {
        std::ofstream(folder / name, std::ios::binary) << bytes;
        return folder / name;
    }
};

std::string error_of(const fs::path& path, uint64_t limit = kTextFileLimit) {
    try {
        read_text_file(path, limit);
    } catch (const InputError& error) {
        return error.what();
    }
    return "no error";
}

std::string long_text() {
    std::string text;
    for (uint32_t i = 0; i < 700000; ++i) text += std::to_string(i * 7919 % 100003) + (i % 10 ? " " : "\n");
    return text;
}

TEST_F(TextFile, plain_and_packed_files_give_the_same_text) {
    const std::string text = long_text();
    EXPECT_EQ(read_text_file(put("plain", text)), text);
    EXPECT_EQ(read_text_file(put("packed", gzip(text))), text);
    EXPECT_EQ(read_text_file(put("two members", gzip(text) + gzip("end"))), text + "end");
    EXPECT_EQ(read_text_file(put("empty", "")), "");
    EXPECT_EQ(read_text_file(put("packed empty", gzip(""))), "");
    EXPECT_EQ(read_file_bytes(folder / "packed"), gzip(text));
}

TEST_F(TextFile, every_cut_of_a_packed_file_is_refused) {
    const std::string packed = gzip("Separator { Cube {} } # some text that packs into a few dozen bytes");
    for (size_t size = 2; size < packed.size(); ++size) {
        const std::string error = error_of(put("cut", packed.substr(0, size)));
        EXPECT_NE(error.find("gzip"), std::string::npos) << size << ": " << error;
    }
    std::string damaged = packed;
    damaged[packed.size() - 6] ^= 1;  // check sum
    EXPECT_NE(error_of(put("damaged", damaged)).find("damaged gzip data"), std::string::npos);
}

TEST_F(TextFile, S11_limits_hold_for_stored_and_unpacked_size) {
    const std::string zeros(5000000, '\0');
    EXPECT_EQ(error_of(put("zeros", zeros), 5000000), "no error");
    EXPECT_NE(error_of(put("zeros", zeros), 4999999).find("the limit is"), std::string::npos);
    EXPECT_NE(error_of(put("bomb", gzip(zeros)), 1000000).find("unpacks to more than"), std::string::npos);
    EXPECT_NE(error_of("/dev/zero", 100000).find("longer than the limit"), std::string::npos);
}

TEST_F(TextFile, errors_name_the_file_and_the_reason) {
    EXPECT_EQ(error_of(folder / "absent"), (folder / "absent").string() + ": No such file or directory");
    EXPECT_EQ(error_of(folder), folder.string() + ": is a folder, not a file");
}

TEST(OneLine, ControlCharactersAndWhatIsNoTextAreEscaped) {
    EXPECT_EQ(one_line("plain: \"100 %\" \\"), "plain: \"100 %\" \\");
    EXPECT_EQ(one_line("a\nb\r\tc"), "a\\nb\\r\\tc");
    EXPECT_EQ(one_line("\x1b[2J\x7f"), "\\x1b[2J\\x7f");
    EXPECT_EQ(one_line("Gr\xc3\xb6\xc3\x9f"
                       "e \xe2\x82\xac \xf0\x9f\x98\x80"),
              "Gr\xc3\xb6\xc3\x9f"
              "e \xe2\x82\xac \xf0\x9f\x98\x80");
    EXPECT_EQ(one_line("\xc2\x9b"
                       "31m"),
              "\\xc2\\x9b"
              "31m")
        << "the other way to write escape [";
    EXPECT_EQ(one_line("\xff \xc3"), "\\xff \\xc3");
    EXPECT_EQ(one_line("\xed\xa0\x80\xc0\xaf"), "\\xed\\xa0\\x80\\xc0\\xaf") << "a surrogate, a slash written too long";
    EXPECT_EQ(one_line(""), "");
}

}  // namespace
}  // namespace trocar
