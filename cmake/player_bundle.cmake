# Writes OUT, a C++ file with the player of report.html: the JavaScript in SOURCE and three.js in one script, made by NODE with
# the packages that NPM loads as package-lock.json pins them. Whatever is missing, OUT is written and the build goes on: then
# without a player.
get_filename_component(folder ${OUT} DIRECTORY)
file(GLOB sources ${SOURCE}/*.js ${SOURCE}/*.json)
file(COPY ${sources} DESTINATION ${folder})
set(reason "")
if(NOT WANTED)
  set(reason "TROCAR_PLAYER is off")
elseif(NOT NODE OR NOT NPM)
  set(reason "Node.js and npm are not there (packages nodejs and npm)")
else()
  execute_process(COMMAND ${CMAKE_COMMAND} -E compare_files ${SOURCE}/package-lock.json ${folder}/loaded.json
                  RESULT_VARIABLE differs OUTPUT_QUIET ERROR_QUIET)
  if(differs)
    execute_process(COMMAND ${NPM} ci --ignore-scripts --no-audit --no-fund --prefer-offline --fetch-retries=1
                            --fetch-retry-mintimeout=1000 --fetch-timeout=20000
                    WORKING_DIRECTORY ${folder} TIMEOUT 300 RESULT_VARIABLE failed OUTPUT_VARIABLE text ERROR_VARIABLE text)
    if(failed)
      string(SUBSTRING "${text}" 0 300 text)
      set(reason "npm could not load its packages:\n${text}")
    else()
      configure_file(${SOURCE}/package-lock.json ${folder}/loaded.json COPYONLY)
    endif()
  endif()
  if(NOT reason)
    execute_process(COMMAND ${NODE} bundle.js ${OUT} WORKING_DIRECTORY ${folder} TIMEOUT 120
                    RESULT_VARIABLE failed OUTPUT_VARIABLE text ERROR_VARIABLE text)
    if(failed)
      set(reason "the bundle failed:\n${text}")
    endif()
  endif()
endif()
if(reason)
  message("note: report.html will have no 3D player: ${reason}")
  file(TOUCH ${folder}/failed)
  file(WRITE ${OUT} "#include \"systems/app/player/player_bundle.hpp\"\nnamespace trocar {\nconst char* const kPlayerScript = \"\";\nconst char* const kPlayerLicences = \"\";\n}  // namespace trocar\n")
endif()
