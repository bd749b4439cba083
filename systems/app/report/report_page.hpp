#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "systems/app/report/figures.hpp"
namespace trocar {

// Pictures and film of a run as addresses for src attributes.
struct ReportMedia {
    std::vector<std::string> picture;
    std::string film;                     // empty if there is none
    std::vector<std::string> worst = {};  // pictures of the slowest passes; empty where none was taken
    std::string player = {};              // section with the 3D player; empty if it is left out
    std::string score = {};               // section about what the hands did; empty if it is left out
};

// RFC 4648, section 4.
std::string base64(std::span<const unsigned char> bytes);

// Embeds twelve pictures at half size, and the film up to 8 MB, as data addresses: the page needs no other
// file. A larger film is linked instead; unreadable pictures are left out. Names are relative to `folder`.
ReportMedia embed_media(const std::filesystem::path& folder, const std::vector<std::string>& pictures, const std::string& film,
                        const std::vector<size_t>& worst = {});

// report.html: one offline page of text, tables and SVG plots that explains its figures.
std::string report_html(const RunFigures& figures, const ReportMedia& media);

// A page in the same style with an HTML body.
std::string html_page(const std::string& title, const std::string& body);

}  // namespace trocar
