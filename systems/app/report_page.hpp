#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "systems/app/figures.hpp"
namespace trocar {

// Pictures and film of a run as they stand in a page: addresses for src attributes.
struct ReportMedia {
    std::vector<std::string> picture;
    std::string film;                     // empty if there is none
    std::vector<std::string> worst = {};  // of the slowest passes; empty where none was taken
};

// Twelve of the pictures at half their size and the film, up to 8 MB of it, as data addresses: the page needs no other
// file. A larger film is named instead; a picture that cannot be read is left out. Names are relative to `folder`.
ReportMedia embed_media(const std::filesystem::path& folder, const std::vector<std::string>& pictures, const std::string& film,
                        const std::vector<size_t>& worst = {});

// report.html: one page of text, tables and SVG plots that opens offline and tells what its figures mean.
std::string report_html(const RunFigures& figures, const ReportMedia& media);

// A page in the same style around a body that is HTML already.
std::string html_page(const std::string& title, const std::string& body);

}  // namespace trocar
