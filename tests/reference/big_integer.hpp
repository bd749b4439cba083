#pragma once
#include <cmath>
#include <cstdint>
#include <vector>
namespace trocar::reference {

// Integer of any size, for oracles: schoolbook arithmetic, sign and magnitude, 32 bits per digit.
struct BigInteger {
    bool negative = false;
    std::vector<uint32_t> digit;  // lowest first, no leading zero
};

inline void trim(BigInteger& a) {
    while (!a.digit.empty() && a.digit.back() == 0) a.digit.pop_back();
    if (a.digit.empty()) a.negative = false;
}

inline int compare_magnitude(const BigInteger& a, const BigInteger& b) {
    if (a.digit.size() != b.digit.size()) return a.digit.size() < b.digit.size() ? -1 : 1;
    for (size_t i = a.digit.size(); i-- > 0;) {
        if (a.digit[i] != b.digit[i]) return a.digit[i] < b.digit[i] ? -1 : 1;
    }
    return 0;
}

inline BigInteger negate(BigInteger a) {
    if (!a.digit.empty()) a.negative = !a.negative;
    return a;
}

inline BigInteger operator+(const BigInteger& a, const BigInteger& b) {
    const bool same_sign = a.negative == b.negative;
    const bool a_larger = compare_magnitude(a, b) >= 0;
    const BigInteger& large = a_larger ? a : b;
    const BigInteger& small = a_larger ? b : a;
    BigInteger out{large.negative, {}};
    int64_t carry = 0;
    for (size_t i = 0; i < large.digit.size(); ++i) {
        const int64_t s = i < small.digit.size() ? small.digit[i] : 0;
        int64_t sum = int64_t{large.digit[i]} + (same_sign ? s : -s) + carry;
        carry = sum >> 32;
        out.digit.push_back(static_cast<uint32_t>(sum));
    }
    if (carry > 0) out.digit.push_back(static_cast<uint32_t>(carry));
    trim(out);
    return out;
}

inline BigInteger operator-(const BigInteger& a, const BigInteger& b) { return a + negate(b); }

inline BigInteger operator*(const BigInteger& a, const BigInteger& b) {
    BigInteger out{a.negative != b.negative, std::vector<uint32_t>(a.digit.size() + b.digit.size(), 0)};
    for (size_t i = 0; i < a.digit.size(); ++i) {
        uint64_t carry = 0;
        for (size_t k = 0; k < b.digit.size(); ++k) {
            const uint64_t t = uint64_t{a.digit[i]} * b.digit[k] + out.digit[i + k] + carry;
            out.digit[i + k] = static_cast<uint32_t>(t);
            carry = t >> 32;
        }
        out.digit[i + b.digit.size()] = static_cast<uint32_t>(carry);
    }
    trim(out);
    return out;
}

inline int sign_of(const BigInteger& a) { return a.digit.empty() ? 0 : (a.negative ? -1 : 1); }

// x * 2^shift, which must be an integer.
inline BigInteger scaled(double x, int shift) {
    int exponent = 0;
    const double fraction = std::frexp(std::abs(x), &exponent);
    uint64_t mantissa = static_cast<uint64_t>(std::ldexp(fraction, 53));
    int power = exponent - 53 + shift;
    while (power < 0 && (mantissa & 1) == 0 && mantissa != 0) {
        mantissa >>= 1;
        ++power;
    }
    BigInteger out{x < 0, {}};
    if (mantissa == 0) return {};
    for (int i = 0; i < power / 32; ++i) out.digit.push_back(0);
    const unsigned __int128 shifted = static_cast<unsigned __int128>(mantissa) << (power % 32);
    for (int i = 0; i < 4; ++i) out.digit.push_back(static_cast<uint32_t>(shifted >> (32 * i)));
    trim(out);
    return out;
}

}  // namespace trocar::reference
