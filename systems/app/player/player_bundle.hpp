#pragma once
namespace trocar {

// page/ and three.js in one script, made when the program is built: compressed by zlib, as base64; empty where Node.js or npm
// were missing then.
extern const char* const kPlayerScript;
extern const char* const kPlayerLicences;  // of what the script contains

}  // namespace trocar
