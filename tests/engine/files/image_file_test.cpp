#include "engine/files/image_file.hpp"

#include <gif_lib.h>
#include <gtest/gtest.h>
#include <jpeglib.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>

#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

Image make_picture(uint32_t width, uint32_t height, bool opaque) {
    Image image{width, height, {}};
    for (uint32_t y = 0; y < height; ++y) {
        for (uint32_t x = 0; x < width; ++x) {
            const uint8_t alpha = opaque ? 255 : static_cast<uint8_t>(x * y);
            for (const uint32_t c : {x * 3 + y, y * 5, x ^ y}) image.rgba.push_back(static_cast<uint8_t>(c));
            image.rgba.push_back(alpha);
        }
    }
    return image;
}

std::string as_text(const std::vector<std::byte>& bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

std::string error_of(std::string_view bytes) {
    try {
        decode_image(bytes, "a.png");
    } catch (const InputError& error) {
        return error.what();
    }
    return "no error";
}

// A JPEG written by the library itself: only reading is under test.
std::string encode_jpeg(const Image& image) {
    jpeg_compress_struct info{};
    jpeg_error_mgr fault{};
    info.err = jpeg_std_error(&fault);
    jpeg_create_compress(&info);
    unsigned char* bytes = nullptr;
    unsigned long size = 0;
    jpeg_mem_dest(&info, &bytes, &size);
    info.image_width = image.width;
    info.image_height = image.height;
    info.input_components = 4;
    info.in_color_space = JCS_EXT_RGBA;
    jpeg_set_defaults(&info);
    jpeg_set_quality(&info, 95, TRUE);
    jpeg_start_compress(&info, TRUE);
    while (info.next_scanline < info.image_height) {
        JSAMPROW row = const_cast<uint8_t*>(image.rgba.data()) + size_t{4} * image.width * info.next_scanline;
        jpeg_write_scanlines(&info, &row, 1);
    }
    jpeg_finish_compress(&info);
    jpeg_destroy_compress(&info);
    std::string text(reinterpret_cast<char*>(bytes), size);
    std::free(bytes);
    return text;
}

// A GIF of 16 colours with frame and canvas of different sizes, optionally interlaced.
std::string encode_gif(bool interlaced, int frame_left) {
    std::string bytes;
    int fault = 0;
    GifFileType* gif = EGifOpen(
        &bytes,
        [](GifFileType* file, const GifByteType* data, int count) {
            static_cast<std::string*>(file->UserData)->append(reinterpret_cast<const char*>(data), static_cast<size_t>(count));
            return count;
        },
        &fault);
    GifColorType colours[16];
    for (int i = 0; i < 16; ++i) colours[i] = {static_cast<uint8_t>(i * 16), static_cast<uint8_t>(255 - i), 7};
    ColorMapObject* map = GifMakeMapObject(16, colours);
    EGifPutScreenDesc(gif, 20, 30, 8, 0, map);
    EGifPutImageDesc(gif, frame_left, 5, 10, 25, interlaced, nullptr);
    std::vector<int> order;
    if (interlaced) {
        for (const auto& [first, step] : {std::pair{0, 8}, {4, 8}, {2, 4}, {1, 2}}) {
            for (int y = first; y < 25; y += step) order.push_back(y);
        }
    } else {
        for (int y = 0; y < 25; ++y) order.push_back(y);
    }
    for (const int y : order) {
        GifPixelType line[10];
        for (int x = 0; x < 10; ++x) line[x] = static_cast<GifPixelType>((x + y) % 16);
        EGifPutLine(gif, line, 10);
    }
    EGifCloseFile(gif, &fault);
    GifFreeMapObject(map);
    return bytes;
}

TEST(ImageFile, png_keeps_every_pixel) {
    for (const bool opaque : {true, false}) {
        for (const auto& [width, height] : {std::pair{1u, 1u}, {7u, 3u}, {640u, 480u}}) {
            const Image image = make_picture(width, height, opaque);
            const std::string png = as_text(encode_png(image));
            EXPECT_EQ(png[25], opaque ? 2 : 6);  // colour type
            const Image back = decode_image(png, "a.png");
            EXPECT_EQ(back.width, width);
            EXPECT_EQ(back.height, height);
            EXPECT_EQ(back.rgba, image.rgba);
        }
    }
}

TEST(ImageFile, jpeg_is_close_to_what_was_written) {
    Image image{64, 48, {}};
    for (uint32_t i = 0; i < 64 * 48; ++i) {
        for (const uint32_t c : {i % 64 * 4, i / 64 * 5, 100u, 255u}) image.rgba.push_back(static_cast<uint8_t>(c));
    }
    const Image back = decode_image(encode_jpeg(image), "a.jpg");
    ASSERT_EQ(back.rgba.size(), image.rgba.size());
    for (size_t i = 0; i < back.rgba.size(); ++i) ASSERT_NEAR(back.rgba[i], image.rgba[i], 10) << i;
}

TEST(ImageFile, gif_frame_lies_where_it_says) {
    for (const bool interlaced : {false, true}) {
        for (const int left : {3, 15}) {  // 15: the frame extends beyond the canvas
            const Image image = decode_image(encode_gif(interlaced, left), "a.gif");
            ASSERT_EQ(image.width, 20u);
            ASSERT_EQ(image.height, 30u);
            for (int y = 0; y < 30; ++y) {
                for (int x = 0; x < 20; ++x) {
                    const uint8_t* p = image.rgba.data() + 4 * (y * 20 + x);
                    const bool inside = x >= left && x < left + 10 && y >= 5;
                    ASSERT_EQ(p[3], inside ? 255 : 0);
                    if (inside) {
                        ASSERT_EQ(p[0], (x - left + y - 5) % 16 * 16);
                        ASSERT_EQ(p[2], 7);
                    }
                }
            }
        }
    }
}

TEST(ImageFile, every_cut_is_refused) {
    const Image image = make_picture(40, 30, true);
    for (const std::string& whole : {as_text(encode_png(image)), encode_jpeg(image), encode_gif(false, 3)}) {
        for (size_t size = 0; size + 20 < whole.size(); size += 7) {
            EXPECT_NE(error_of(whole.substr(0, size)), "no error") << size << " of " << whole.size();
        }
    }
}

TEST(ImageFile, damaged_pictures_end_in_an_answer_or_an_error) {
    const Image image = make_picture(40, 30, false);
    uint32_t random = 1;
    for (const std::string& whole : {as_text(encode_png(image)), encode_jpeg(image), encode_gif(true, 3)}) {
        for (int i = 0; i < 300; ++i) {
            std::string mutant = whole;
            for (int k = 0; k < 3; ++k) {
                random = random * 1664525u + 1013904223u;
                mutant[random / 7 % mutant.size()] = static_cast<char>(random >> 24);
            }
            error_of(mutant);
        }
    }
}

TEST(ImageFile, a_picture_beyond_the_limit_is_refused_before_it_is_allocated) {
    std::string png = as_text(encode_png(make_picture(2, 2, true)));
    png.replace(16, 8, std::string("\0\0\xff\xff\0\0\xff\xff", 8));
    EXPECT_NE(error_of(png), "no error");
    std::string gif = encode_gif(false, 3);
    gif.replace(6, 4, "\xff\xff\xff\xff");
    EXPECT_NE(error_of(gif).find("65535 x 65535 pixels, the limit is"), std::string::npos) << error_of(gif);
    EXPECT_EQ(error_of(""), "a.png: empty file");
    EXPECT_EQ(error_of("BM12"), "a.png: not a picture this program reads (PNG, JPEG, GIF)");
}

TEST(ImageFile, saves_and_loads_by_name) {
    const fs::path path = fs::temp_directory_path() / ("trocar_image_" + std::to_string(::getpid()) + ".png");
    const Image image = make_picture(9, 5, false);
    save_png(image, path);
    EXPECT_EQ(load_image(path).rgba, image.rgba);
    fs::remove(path);
    EXPECT_THROW(load_image(path), InputError);
    EXPECT_THROW(save_png(image, "/dev/full"), InputError);
}

}  // namespace
}  // namespace trocar
