#include <algorithm>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <span>

#include "engine/base/error.hpp"
#include "engine/files/image_file.hpp"
#include "systems/app/report/report_page.hpp"
namespace trocar {
namespace {

constexpr size_t kPictures = 12;
constexpr uintmax_t kLargestFilm = 8u << 20;  // bytes

}  // namespace

std::string base64(std::span<const unsigned char> bytes) {
    constexpr char kDigit[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    out.reserve((bytes.size() + 2) / 3 * 4);
    for (size_t i = 0; i < bytes.size(); i += 3) {
        const size_t count = std::min<size_t>(3, bytes.size() - i);
        uint32_t group = 0;
        for (size_t k = 0; k < 3; ++k) group = group << 8 | (k < count ? bytes[i + k] : 0u);
        for (size_t k = 0; k < 4; ++k) out += k <= count ? kDigit[group >> (18 - 6 * k) & 63] : '=';
    }
    return out;
}

ReportMedia embed_media(const std::filesystem::path& folder, const std::vector<std::string>& pictures, const std::string& film,
                        const std::vector<size_t>& worst) {
    ReportMedia media;
    const auto embed = [&](size_t row) -> std::string {
        try {
            const std::vector<std::byte> png = encode_png(halved(load_image(folder / pictures.at(row))));
            return "data:image/png;base64," + base64({reinterpret_cast<const unsigned char*>(png.data()), png.size()});
        } catch (const InputError&) {
            return {};
        }
    };
    for (const size_t row : worst) media.worst.push_back(row < pictures.size() ? embed(row) : "");
    const size_t count = std::min(kPictures, pictures.size());
    for (size_t i = 0; i < count; ++i) {
        // spread evenly from the first to the last picture
        const size_t row = count > 1 ? i * (pictures.size() - 1) / (count - 1) : 0;
        if (std::string picture = embed(row); !picture.empty()) media.picture.push_back(std::move(picture));
    }
    if (film.empty()) return media;
    std::error_code error;
    const uintmax_t size = std::filesystem::file_size(folder / film, error);
    media.film = film;
    if (error || size > kLargestFilm) return media;
    std::ifstream file(folder / film, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), {}};
    if (bytes.size() == size)
        media.film = "data:video/mp4;base64," + base64({reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()});
    return media;
}

}  // namespace trocar
