#pragma once
#define GL_GLEXT_PROTOTYPES
#include <GL/osmesa.h>
namespace trocar {

// A function of OSMesa's library, which is loaded at the first request: with LLVM it takes 50 ms and 40 MB
// that a run without pictures does not need. Throws InputError if the library or the function is missing.
void* osmesa_function(const char* name);

// Every OpenGL and OSMesa function in use, under its own name; in this namespace it hides the linked one.
#define TROCAR_OSMESA_FUNCTION(name)                                                              \
    template <typename... Arguments>                                                              \
    auto name(Arguments... arguments) {                                                           \
        static const auto function = reinterpret_cast<decltype(&::name)>(osmesa_function(#name)); \
        return function(arguments...);                                                            \
    }
TROCAR_OSMESA_FUNCTION(OSMesaCreateContextAttribs)
TROCAR_OSMESA_FUNCTION(OSMesaDestroyContext)
TROCAR_OSMESA_FUNCTION(OSMesaMakeCurrent)
TROCAR_OSMESA_FUNCTION(glActiveTexture)
TROCAR_OSMESA_FUNCTION(glAttachShader)
TROCAR_OSMESA_FUNCTION(glBindBuffer)
TROCAR_OSMESA_FUNCTION(glBindFramebuffer)
TROCAR_OSMESA_FUNCTION(glBindRenderbuffer)
TROCAR_OSMESA_FUNCTION(glBindTexture)
TROCAR_OSMESA_FUNCTION(glBindVertexArray)
TROCAR_OSMESA_FUNCTION(glBlendFuncSeparate)
TROCAR_OSMESA_FUNCTION(glBlitFramebuffer)
TROCAR_OSMESA_FUNCTION(glBufferData)
TROCAR_OSMESA_FUNCTION(glBufferSubData)
TROCAR_OSMESA_FUNCTION(glCheckFramebufferStatus)
TROCAR_OSMESA_FUNCTION(glClear)
TROCAR_OSMESA_FUNCTION(glCompileShader)
TROCAR_OSMESA_FUNCTION(glCreateProgram)
TROCAR_OSMESA_FUNCTION(glCreateShader)
TROCAR_OSMESA_FUNCTION(glCullFace)
TROCAR_OSMESA_FUNCTION(glDeleteFramebuffers)
TROCAR_OSMESA_FUNCTION(glDeleteRenderbuffers)
TROCAR_OSMESA_FUNCTION(glDeleteShader)
TROCAR_OSMESA_FUNCTION(glDepthFunc)
TROCAR_OSMESA_FUNCTION(glDepthMask)
TROCAR_OSMESA_FUNCTION(glDisable)
TROCAR_OSMESA_FUNCTION(glDisableVertexAttribArray)
TROCAR_OSMESA_FUNCTION(glDrawArrays)
TROCAR_OSMESA_FUNCTION(glDrawElements)
TROCAR_OSMESA_FUNCTION(glEnable)
TROCAR_OSMESA_FUNCTION(glEnableVertexAttribArray)
TROCAR_OSMESA_FUNCTION(glFramebufferRenderbuffer)
TROCAR_OSMESA_FUNCTION(glGenBuffers)
TROCAR_OSMESA_FUNCTION(glGenFramebuffers)
TROCAR_OSMESA_FUNCTION(glGenRenderbuffers)
TROCAR_OSMESA_FUNCTION(glGenTextures)
TROCAR_OSMESA_FUNCTION(glGenVertexArrays)
TROCAR_OSMESA_FUNCTION(glGenerateMipmap)
TROCAR_OSMESA_FUNCTION(glGetIntegerv)
TROCAR_OSMESA_FUNCTION(glGetProgramiv)
TROCAR_OSMESA_FUNCTION(glGetShaderInfoLog)
TROCAR_OSMESA_FUNCTION(glGetShaderiv)
TROCAR_OSMESA_FUNCTION(glGetString)
TROCAR_OSMESA_FUNCTION(glGetUniformLocation)
TROCAR_OSMESA_FUNCTION(glLinkProgram)
TROCAR_OSMESA_FUNCTION(glMapBufferRange)
TROCAR_OSMESA_FUNCTION(glPixelStorei)
TROCAR_OSMESA_FUNCTION(glReadPixels)
TROCAR_OSMESA_FUNCTION(glRenderbufferStorage)
TROCAR_OSMESA_FUNCTION(glShaderSource)
TROCAR_OSMESA_FUNCTION(glTexImage2D)
TROCAR_OSMESA_FUNCTION(glTexParameteri)
TROCAR_OSMESA_FUNCTION(glUniform1f)
TROCAR_OSMESA_FUNCTION(glUniform1i)
TROCAR_OSMESA_FUNCTION(glUniform2f)
TROCAR_OSMESA_FUNCTION(glUniform3f)
TROCAR_OSMESA_FUNCTION(glUniform3fv)
TROCAR_OSMESA_FUNCTION(glUniform4f)
TROCAR_OSMESA_FUNCTION(glUniformMatrix3fv)
TROCAR_OSMESA_FUNCTION(glUniformMatrix4fv)
TROCAR_OSMESA_FUNCTION(glUnmapBuffer)
TROCAR_OSMESA_FUNCTION(glUseProgram)
TROCAR_OSMESA_FUNCTION(glVertexAttrib1f)
TROCAR_OSMESA_FUNCTION(glVertexAttrib2f)
TROCAR_OSMESA_FUNCTION(glVertexAttribPointer)
TROCAR_OSMESA_FUNCTION(glViewport)
#undef TROCAR_OSMESA_FUNCTION

}  // namespace trocar
