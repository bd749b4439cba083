#include "engine/files/image_file.hpp"

#include <gif_lib.h>
#include <jerror.h>
#include <jpeglib.h>
#include <libdeflate.h>
#include <png.h>

#include <algorithm>
#include <csetjmp>
#include <cstdio>
#include <cstring>

#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/files/zlib_bytes.hpp"
namespace trocar {
namespace {

constexpr uint64_t kImageFileLimit = uint64_t{1} << 28;  // bytes

[[noreturn]] void fail(const std::string& name, const std::string& reason) { throw InputError(name + ": " + reason); }

void check_size(uint64_t width, uint64_t height, const std::string& name) {
    if (width == 0 || height == 0) fail(name, "picture without pixels");
    if (width > kImagePixelLimit || height > kImagePixelLimit || width * height > kImagePixelLimit) {
        fail(name, "picture of " + std::to_string(width) + " x " + std::to_string(height) + " pixels, the limit is " +
                       std::to_string(kImagePixelLimit));
    }
}

Image decode_png(std::string_view bytes, const std::string& name) {
    // libpng's simplified reader handles its longjmp internally
    png_image reader{};
    reader.version = PNG_IMAGE_VERSION;
    struct Free {
        png_image* image;
        ~Free() { png_image_free(image); }
    } free_reader{&reader};
    if (!png_image_begin_read_from_memory(&reader, bytes.data(), bytes.size())) {
        fail(name, std::string("damaged PNG: ") + reader.message);
    }
    check_size(reader.width, reader.height, name);
    reader.format = PNG_FORMAT_RGBA;
    Image image{reader.width, reader.height, {}};
    image.rgba.resize(PNG_IMAGE_SIZE(reader));
    if (!png_image_finish_read(&reader, nullptr, image.rgba.data(), 0, nullptr)) {
        fail(name, std::string("damaged PNG: ") + reader.message);
    }
    return image;
}

// State for libjpeg's callbacks. Plain data only, so that longjmp skips no destructor.
struct JpegFault {
    jpeg_error_mgr base;
    jmp_buf jump;
    char message[JMSG_LENGTH_MAX];
};

void on_jpeg_error(j_common_ptr info) {
    auto* fault = reinterpret_cast<JpegFault*>(info->err);
    fault->base.format_message(info, fault->message);
    std::longjmp(fault->jump, 1);
}

void on_jpeg_message(j_common_ptr info, int level) {
    // a truncated picture is filled with grey, which we treat as an error, unlike other warnings
    if (level < 0 && info->err->msg_code == JWRN_JPEG_EOF) on_jpeg_error(info);
}

enum class JpegStep { kFailed, kTooLarge, kDone };

// Decodes into `rows` (allocated by grow once the size is known). Must not own objects with destructors.
JpegStep run_jpeg(jpeg_decompress_struct& info, JpegFault& fault, std::string_view bytes, void* user,
                  uint8_t* (*grow)(void* user, uint32_t width, uint32_t height)) {
    if (setjmp(fault.jump)) return JpegStep::kFailed;
    jpeg_mem_src(&info, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
    jpeg_read_header(&info, TRUE);
    const bool cmyk = info.jpeg_color_space == JCS_CMYK || info.jpeg_color_space == JCS_YCCK;
    info.out_color_space = cmyk ? JCS_CMYK : JCS_EXT_RGBA;
    if (static_cast<uint64_t>(info.image_width) * info.image_height > kImagePixelLimit) return JpegStep::kTooLarge;
    uint8_t* pixels = grow(user, info.image_width, info.image_height);
    if (!pixels) return JpegStep::kTooLarge;
    jpeg_start_decompress(&info);
    while (info.output_scanline < info.output_height) {
        JSAMPROW row = pixels + static_cast<size_t>(info.output_scanline) * info.output_width * 4;
        jpeg_read_scanlines(&info, &row, 1);
    }
    jpeg_finish_decompress(&info);
    if (cmyk) {
        // Adobe's files store inverted ink, that is, the remaining light
        const bool inverted = info.saw_Adobe_marker;
        for (size_t i = 0; i < static_cast<size_t>(info.output_width) * info.output_height; ++i) {
            uint8_t* p = pixels + 4 * i;
            const auto light = [&](uint8_t ink) { return inverted ? ink : 255 - ink; };
            const int black = light(p[3]);
            for (int c = 0; c < 3; ++c) p[c] = static_cast<uint8_t>(light(p[c]) * black / 255);
            p[3] = 255;
        }
    }
    return JpegStep::kDone;
}

Image decode_jpeg(std::string_view bytes, const std::string& name) {
    Image image;
    jpeg_decompress_struct info{};
    JpegFault fault{};
    info.err = jpeg_std_error(&fault.base);
    fault.base.error_exit = on_jpeg_error;
    fault.base.emit_message = on_jpeg_message;
    jpeg_create_decompress(&info);
    const auto grow = [](void* user, uint32_t width, uint32_t height) -> uint8_t* {
        Image& out = *static_cast<Image*>(user);
        try {
            out.rgba.resize(static_cast<size_t>(width) * height * 4);
        } catch (const std::bad_alloc&) {
            return nullptr;  // an exception must not cross libjpeg's frames
        }
        out.width = width;
        out.height = height;
        return out.rgba.data();
    };
    const JpegStep step = run_jpeg(info, fault, bytes, &image, grow);
    const uint32_t width = info.image_width, height = info.image_height;
    jpeg_destroy_decompress(&info);
    if (step == JpegStep::kFailed) fail(name, std::string("damaged JPEG: ") + fault.message);
    if (step == JpegStep::kTooLarge) {
        check_size(width, height, name);
        fail(name, "not enough memory for the picture");
    }
    return image;
}

struct GifBytes {
    std::string_view bytes;
    size_t used = 0;
};

int read_gif_bytes(GifFileType* gif, GifByteType* out, int count) {
    auto& source = *static_cast<GifBytes*>(gif->UserData);
    const size_t compliance = std::min(static_cast<size_t>(count), source.bytes.size() - source.used);
    std::memcpy(out, source.bytes.data() + source.used, compliance);
    source.used += compliance;
    return static_cast<int>(compliance);
}

// Copies one row of palette indices of the first frame onto the canvas, clipped to it.
void place_gif_row(const GifFileType& gif, const ColorMapObject& colours, int transparent, uint32_t row,
                   const std::vector<GifPixelType>& line, Image& image) {
    const int64_t y = int64_t{gif.Image.Top} + row;
    if (y < 0 || y >= int64_t{image.height}) return;
    for (size_t i = 0; i < line.size(); ++i) {
        const int64_t x = int64_t{gif.Image.Left} + static_cast<int64_t>(i);
        if (x < 0 || x >= int64_t{image.width} || line[i] == transparent || line[i] >= colours.ColorCount) continue;
        const GifColorType& colour = colours.Colors[line[i]];
        uint8_t* p = image.rgba.data() + 4 * (static_cast<size_t>(y) * image.width + static_cast<size_t>(x));
        p[0] = colour.Red, p[1] = colour.Green, p[2] = colour.Blue, p[3] = 255;
    }
}

void read_gif_frame(GifFileType& gif, int transparent, const std::string& name, Image& image) {
    if (DGifGetImageDesc(&gif) != GIF_OK) fail(name, "damaged GIF: no picture in it");
    check_size(static_cast<uint64_t>(gif.Image.Width), static_cast<uint64_t>(gif.Image.Height), name);
    const ColorMapObject* colours = gif.Image.ColorMap ? gif.Image.ColorMap : gif.SColorMap;
    if (!colours) fail(name, "damaged GIF: no palette");
    const auto height = static_cast<uint32_t>(gif.Image.Height);
    std::vector<GifPixelType> line(static_cast<size_t>(gif.Image.Width));
    const auto read_row = [&](uint32_t row) {
        if (DGifGetLine(&gif, line.data(), static_cast<int>(line.size())) != GIF_OK) {
            fail(name, "damaged GIF: cut short in row " + std::to_string(row));
        }
        place_gif_row(gif, *colours, transparent, row, line, image);
    };
    if (gif.Image.Interlace) {
        constexpr uint32_t kFirst[4] = {0, 4, 2, 1}, kStep[4] = {8, 8, 4, 2};
        for (int pass = 0; pass < 4; ++pass) {
            for (uint32_t row = kFirst[pass]; row < height; row += kStep[pass]) read_row(row);
        }
    } else {
        for (uint32_t row = 0; row < height; ++row) read_row(row);
    }
}

Image decode_gif(std::string_view bytes, const std::string& name) {
    GifBytes source{bytes};
    int fault = 0;
    struct Close {
        GifFileType* gif;
        ~Close() {
            int ignored = 0;
            if (gif) DGifCloseFile(gif, &ignored);
        }
    } file{DGifOpen(&source, read_gif_bytes, &fault)};
    if (!file.gif) fail(name, std::string("damaged GIF: ") + GifErrorString(fault));
    GifFileType& gif = *file.gif;
    check_size(static_cast<uint64_t>(gif.SWidth), static_cast<uint64_t>(gif.SHeight), name);
    Image image{static_cast<uint32_t>(gif.SWidth), static_cast<uint32_t>(gif.SHeight), {}};
    image.rgba.resize(size_t{4} * image.width * image.height);
    int transparent = NO_TRANSPARENT_COLOR;
    while (true) {
        GifRecordType type = UNDEFINED_RECORD_TYPE;
        if (DGifGetRecordType(&gif, &type) != GIF_OK) fail(name, "damaged GIF: no picture in it");
        if (type == IMAGE_DESC_RECORD_TYPE) break;
        if (type != EXTENSION_RECORD_TYPE) fail(name, "GIF without a picture");
        int code = 0;
        GifByteType* block = nullptr;
        if (DGifGetExtension(&gif, &code, &block) != GIF_OK) fail(name, "damaged GIF");
        while (block) {
            GraphicsControlBlock control{};
            if (code == GRAPHICS_EXT_FUNC_CODE && DGifExtensionToGCB(block[0], block + 1, &control) == GIF_OK) {
                transparent = control.TransparentColor;
            }
            if (DGifGetExtensionNext(&gif, &block) != GIF_OK) fail(name, "damaged GIF");
        }
    }
    read_gif_frame(gif, transparent, name, image);
    return image;
}

void append_word(std::vector<std::byte>& out, uint32_t value) {
    for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<std::byte>(value >> shift & 0xff));
}

// Length, type, data and check sum of one PNG chunk (PNG specification, section 5.3).
void append_chunk(std::vector<std::byte>& out, const char* type, const uint8_t* data, size_t size) {
    append_word(out, static_cast<uint32_t>(size));
    const size_t first = out.size();
    for (int i = 0; i < 4; ++i) out.push_back(static_cast<std::byte>(type[i]));
    out.insert(out.end(), reinterpret_cast<const std::byte*>(data), reinterpret_cast<const std::byte*>(data + size));
    append_word(out, libdeflate_crc32(0, out.data() + first, size + 4));
}

// Rows with filter "up", which costs one subtraction and suits rendered pictures.
std::vector<uint8_t> filter_rows(const Image& image, size_t channels) {
    const size_t row_bytes = channels * image.width;
    std::vector<uint8_t> rows((row_bytes + 1) * image.height);
    std::vector<uint8_t> above(row_bytes), here(row_bytes);
    for (uint32_t y = 0; y < image.height; ++y) {
        const uint8_t* source = image.rgba.data() + size_t{4} * image.width * y;
        if (channels == 4) {
            std::memcpy(here.data(), source, row_bytes);
        } else {
            for (size_t x = 0; x < image.width; ++x) std::memcpy(here.data() + 3 * x, source + 4 * x, 3);
        }
        uint8_t* out = rows.data() + (row_bytes + 1) * y;
        *out++ = 2;
        for (size_t i = 0; i < row_bytes; ++i) out[i] = static_cast<uint8_t>(here[i] - above[i]);
        above.swap(here);
    }
    return rows;
}

}  // namespace

Image decode_image(std::string_view bytes, const std::string& name) {
    if (bytes.starts_with("\x89PNG\r\n\x1a\n")) return decode_png(bytes, name);
    if (bytes.starts_with("\xff\xd8\xff")) return decode_jpeg(bytes, name);
    if (bytes.starts_with("GIF8")) return decode_gif(bytes, name);
    fail(name, bytes.empty() ? "empty file" : "not a picture this program reads (PNG, JPEG, GIF)");
}

Image load_image(const std::filesystem::path& path) { return decode_image(read_file_bytes(path, kImageFileLimit), path.string()); }

Image halved(const Image& from) {
    Image half{std::max(1u, from.width / 2), std::max(1u, from.height / 2), {}};
    half.rgba.resize(size_t{4} * half.width * half.height);
    for (uint32_t y = 0; y < half.height; ++y)
        for (uint32_t x = 0; x < half.width; ++x)
            for (uint32_t c = 0; c < 4; ++c) {
                const auto at = [&](uint32_t dx, uint32_t dy) {
                    const size_t px = std::min(2 * x + dx, from.width - 1), py = std::min(2 * y + dy, from.height - 1);
                    return uint32_t{from.rgba[4 * (py * from.width + px) + c]};
                };
                half.rgba[4 * (size_t{y} * half.width + x) + c] = static_cast<uint8_t>((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1) + 2) / 4);
            }
    return half;
}

std::vector<std::byte> encode_png(const Image& image) {
    TROCAR_ASSERT(image.width > 0 && image.height > 0);
    TROCAR_ASSERT(image.rgba.size() == size_t{4} * image.width * image.height);
    bool opaque = true;
    for (size_t i = 3; i < image.rgba.size(); i += 4) opaque = opaque && image.rgba[i] == 255;
    const std::vector<uint8_t> rows = filter_rows(image, opaque ? 3 : 4);
    // live pictures are compressed thirty times a second: the fastest level takes half of zlib's time and is
    // no larger
    const std::vector<uint8_t> packed = zlib_compress(rows, 1);

    std::vector<std::byte> out;
    out.reserve(packed.size() + 64);
    for (const uint8_t byte : {0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a}) out.push_back(std::byte{byte});
    uint8_t header[13] = {};
    for (int i = 0; i < 4; ++i) {
        header[i] = static_cast<uint8_t>(image.width >> (24 - 8 * i));
        header[4 + i] = static_cast<uint8_t>(image.height >> (24 - 8 * i));
    }
    header[8] = 8;               // bits a channel
    header[9] = opaque ? 2 : 6;  // RGB or RGBA
    append_chunk(out, "IHDR", header, sizeof header);
    append_chunk(out, "IDAT", packed.data(), packed.size());
    append_chunk(out, "IEND", nullptr, 0);
    return out;
}

void save_png(const Image& image, const std::filesystem::path& path) { write_whole_file(path, encode_png(image)); }

}  // namespace trocar
