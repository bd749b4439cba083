#include "engine/draw/offscreen.hpp"

#include <dlfcn.h>

#include <array>
#include <cstdlib>

#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/draw/gl_functions.hpp"

#ifdef __SANITIZE_ADDRESS__
// OSMesaDestroyContext leaks the buffer of OSMesaMakeCurrent: 160 bytes per context, which we cannot free.
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() { return "leak:libOSMesa\n"; }
#endif

namespace trocar {

struct OffscreenContext::Impl {
    OSMesaContext context = nullptr;
    std::array<uint8_t, 4> unused{};  // required by OSMesa, although we draw into framebuffer objects
};

void* osmesa_function(const char* name) {
    const auto needed = [](void* found) {
        if (!found) throw InputError(std::string("pictures need OSMesa (package libosmesa6): ") + dlerror());
        return found;
    };
    static void* const library = needed(dlopen(TROCAR_OSMESA_LIBRARY, RTLD_NOW | RTLD_LOCAL));
    return needed(dlsym(library, name));
}

void set_offscreen_threads(uint32_t threads) { setenv("LP_NUM_THREADS", std::to_string(threads).c_str(), 0); }

OffscreenContext::OffscreenContext() : impl_(std::make_unique<Impl>()) {
    const int attributes[] = {OSMESA_FORMAT,
                              OSMESA_RGBA,
                              OSMESA_DEPTH_BITS,
                              0,
                              OSMESA_PROFILE,
                              OSMESA_CORE_PROFILE,
                              OSMESA_CONTEXT_MAJOR_VERSION,
                              3,
                              OSMESA_CONTEXT_MINOR_VERSION,
                              3,
                              0};
    impl_->context = trocar::OSMesaCreateContextAttribs(attributes, nullptr);
    if (!impl_->context) throw InputError("OSMesa: no OpenGL 3.3 core context");
}

OffscreenContext::~OffscreenContext() { trocar::OSMesaDestroyContext(impl_->context); }

void OffscreenContext::make_current() {
    const bool made = trocar::OSMesaMakeCurrent(impl_->context, impl_->unused.data(), GL_UNSIGNED_BYTE, 1, 1);
    TROCAR_ASSERT(made);
}

void OffscreenContext::release() { trocar::OSMesaMakeCurrent(nullptr, nullptr, 0, 0, 0); }

std::string offscreen_library(OffscreenContext& context) {
    context.make_current();
    const auto text = [](GLenum name) { return std::string(reinterpret_cast<const char*>(glGetString(name))); };
    std::string library = text(GL_RENDERER) + ", " + text(GL_VERSION);
    context.release();
    return library;
}

}  // namespace trocar
