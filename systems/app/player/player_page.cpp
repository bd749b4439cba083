#include "systems/app/player/player_page.hpp"

#include <cstring>

#include "engine/files/zlib_bytes.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/player/player_bundle.hpp"
#include "systems/app/report/report_page.hpp"
#include "systems/app/report/svg_plot.hpp"
namespace trocar {
namespace {

constexpr int kLevel = 9;  // of compression: 10 to 12 take ten times as long for 2 %

std::string text_section(const std::string& text) { return "<h2>3D player</h2><p>" + text + "</p>\n"; }

std::string megabytes(size_t bytes) { return format("%.2f MB", static_cast<double>(bytes) * 1e-6); }

std::string packed(const PlayerRecorder& recorder, const std::string& scene, const Camera& camera) {
    return base64(zlib_compress(recorder.coded(scene, camera), kLevel));
}

// Unpacks script and recording, and starts the player; says on the page what went wrong.
constexpr const char* kStart =
    "(async()=>{const host=document.getElementById('player'),bytes=async id=>{const "
    "text=document.getElementById(id).textContent.trim(),packed=Uint8Array.from(atob(text),c=>c.charCodeAt(0));return new "
    "Uint8Array(await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'))).arrayBuffer())};"
    "const script=document.createElement('script');script.textContent=new TextDecoder().decode(await "
    "bytes('player-script'));document.head.append(script);trocarPlayer(host,await bytes('player-recording'))})()"
    ".catch(e=>{document.getElementById('player').textContent='The player does not run in this browser: '+e.message});";

}  // namespace

bool has_player() { return *kPlayerScript != 0; }

std::string packed_player_script() {
    std::string bytes;
    uint32_t bits = 0, count = 0;
    for (const char* c = kPlayerScript; *c != 0 && *c != '='; ++c) {
        const size_t digit = std::string_view("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/").find(*c);
        bits = bits << 6 | static_cast<uint32_t>(digit), count += 6;
        if (count >= 8) count -= 8, bytes += static_cast<char>(bits >> count & 255);
    }
    return bytes;
}

std::string missing_player_section() {
    return text_section("This program was built without the player: Node.js and npm, or the packages they load, were not there then.");
}

std::string player_section(PlayerRecorder& recorder, const std::string& scene, const Camera& camera, size_t largest) {
    if (!has_player()) return missing_player_section();
    std::string recording = packed(recorder, scene, camera);
    while (recording.size() > largest && recorder.halve()) recording = packed(recorder, scene, camera);
    if (recording.size() > largest)
        return text_section("Left out: one frame alone takes " + megabytes(recording.size()) + ", more than the " + megabytes(largest) +
                            " that a page may hold.");
    const size_t shown = recorder.frames().size(), all = recorder.offered();
    std::string note = std::to_string(shown) + " frames, " + megabytes(recording.size()) + " in this page and " +
                       megabytes(std::strlen(kPlayerScript)) + " for the player itself; ";
    if (shown < all) note += "of " + std::to_string(all) + ", so that it stays below " + megabytes(largest) + "; ";
    note += format("positions are exact to %.2g um. ", 1e6 * recorder.worst_error());
    note += "Contacts were found at the start of the pass at whose end the bodies are shown; their forces are means over that pass.";
    return text_section(note) + "<div id=\"player\"><noscript>The player needs JavaScript.</noscript></div>\n" +
           "<details><summary>Licence of three.js</summary><pre>" + escape_html(kPlayerLicences) + "</pre></details>\n" +
           "<script type=\"application/octet-stream\" id=\"player-script\">" + kPlayerScript + "</script>\n" +
           "<script type=\"application/octet-stream\" id=\"player-recording\">" + recording + "</script>\n<script>" + kStart +
           "</script>\n";
}

}  // namespace trocar
