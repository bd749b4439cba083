#include "content/text/number_text.hpp"

#include <charconv>
#include <cstdint>
#include <cstdlib>
#include <string>
namespace trocar {
namespace {

constexpr double kPowersOfTen[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                   1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

bool is_digit(char c) { return static_cast<unsigned char>(c - '0') < 10; }

double parse_slowly(const char* begin, const char* end) {
    double value = 0;
    const std::from_chars_result result = std::from_chars(begin, end, value);
    // from_chars does not report which end of the range was exceeded
    if (result.ec == std::errc::result_out_of_range) return std::strtod(std::string(begin, end).c_str(), nullptr);
    return value;
}

}  // namespace

const char* parse_number(const char* at, const char* end, double& value) {
    bool negative = false;
    if (at != end && (*at == '-' || *at == '+')) negative = *at++ == '-';
    const char* const begin = at;
    uint64_t mantissa = 0;
    const char* digits = at;
    while (at != end && is_digit(*at)) mantissa = mantissa * 10 + static_cast<uint64_t>(*at++ - '0');
    int64_t count = at - digits;
    int64_t exponent = 0;
    if (at != end && *at == '.') {
        digits = ++at;
        while (at != end && is_digit(*at)) mantissa = mantissa * 10 + static_cast<uint64_t>(*at++ - '0');
        exponent = digits - at;
        count -= exponent;
    }
    if (count == 0) return nullptr;
    if (at != end && (*at == 'e' || *at == 'E')) {
        const char* power = at + 1;
        const bool down = power != end && *power == '-';
        if (power != end && (*power == '-' || *power == '+')) ++power;
        if (power != end && is_digit(*power)) {
            int64_t tens = 0;
            for (; power != end && is_digit(*power); ++power) tens = tens < 100000 ? tens * 10 + (*power - '0') : tens;
            exponent += down ? -tens : tens;
            at = power;
        }
    }
    // mantissa and power of ten are exact: one rounding gives the nearest double (Clinger 1990, section 5)
    double magnitude;
    if (count <= 19 && mantissa <= uint64_t{1} << 53 && exponent >= -22 && exponent <= 22) {
        const auto exact = static_cast<double>(mantissa);
        magnitude = exponent < 0 ? exact / kPowersOfTen[-exponent] : exact * kPowersOfTen[exponent];
    } else {
        magnitude = parse_slowly(begin, at);
    }
    value = negative ? -magnitude : magnitude;
    return at;
}

}  // namespace trocar
