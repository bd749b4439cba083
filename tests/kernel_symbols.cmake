# Units compiled for one instruction set must not bring weak symbols (inline functions, templates): the linker could take
# their copy for everybody and the program would stop on machines without that set.
file(GLOB_RECURSE objects ${BUILD}/CMakeFiles/trocar_engine.dir/*_avx512.cpp.o ${BUILD}/CMakeFiles/trocar_engine.dir/*_avx2.cpp.o)
list(LENGTH objects count)
if(count LESS 4)
  message(FATAL_ERROR "only ${count} kernel units found: nothing was checked")
endif()
foreach(object ${objects})
  execute_process(COMMAND nm --defined-only ${object} OUTPUT_VARIABLE symbols RESULT_VARIABLE result)
  if(NOT result EQUAL 0 OR symbols MATCHES " [WVu] ")
    message(FATAL_ERROR "${object} defines weak symbols:\n${symbols}")
  endif()
endforeach()
