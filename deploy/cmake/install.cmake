# What `cmake --install` lays down: headers, static libraries, the programs and the CMake package Raymill.
# Users write find_package(Raymill), link Raymill::raymill and include <raymill/raymill.h>.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# Public headers and what they include, by their path in the repository.
set(raymill_public_headers
  storage/base/status.h
  storage/base/ledger.h
  storage/io/build_store.h
  storage/io/store_costs.h
  traversal/query.h
  traversal/service.h
  traversal/engine.h
  traversal/page_trace.h
  traversal/timeline.h
  client/cpp/client.h
  client/cpp/raymill.h)
set(raymill_include_directory ${CMAKE_INSTALL_INCLUDEDIR}/raymill)
foreach(header IN LISTS raymill_public_headers)
  cmake_path(GET header PARENT_PATH folder)
  install(FILES ${PROJECT_SOURCE_DIR}/${header} DESTINATION ${raymill_include_directory}/${folder})
endforeach()
install(FILES ${PROJECT_SOURCE_DIR}/client/cpp/raymill.h DESTINATION ${raymill_include_directory})

# Our warnings and the path of this tree are for building only; users of the package see the installed headers.
get_target_property(own_options raymill_flags INTERFACE_COMPILE_OPTIONS)
get_target_property(own_directories raymill_flags INTERFACE_INCLUDE_DIRECTORIES)
set_target_properties(raymill_flags PROPERTIES
  INTERFACE_COMPILE_OPTIONS "$<BUILD_INTERFACE:${own_options}>"
  INTERFACE_INCLUDE_DIRECTORIES
    "$<BUILD_INTERFACE:${own_directories}>;$<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR};${raymill_include_directory}>")

# Appends to the list `result` each library of ours that `target` needs, itself included.
function(raymill_collect_libraries target result)
  if(NOT TARGET ${target} OR ${target} IN_LIST ${result})
    return()
  endif()
  get_target_property(imported ${target} IMPORTED)
  get_target_property(alias ${target} ALIASED_TARGET)
  if(imported OR alias)
    return()
  endif()
  list(APPEND ${result} ${target})
  foreach(property IN ITEMS LINK_LIBRARIES INTERFACE_LINK_LIBRARIES)
    get_target_property(needed ${target} ${property})
    foreach(entry IN LISTS needed)
      string(REGEX REPLACE "^\\$<LINK_ONLY:(.*)>$" "\\1" entry "${entry}")
      if(entry MATCHES "^[A-Za-z_0-9]+$")
        raymill_collect_libraries(${entry} ${result})
      endif()
    endforeach()
  endforeach()
  set(${result} ${${result}} PARENT_SCOPE)
endfunction()

# The one target that users link: embedded engine, client, builder.
add_library(raymill_package INTERFACE)
set_target_properties(raymill_package PROPERTIES EXPORT_NAME raymill)
target_compile_features(raymill_package INTERFACE cxx_std_20)
foreach(library IN ITEMS raymill_client raymill_traversal raymill_builder)
  if(TARGET ${library})
    target_link_libraries(raymill_package INTERFACE ${library})
  endif()
endforeach()
add_library(Raymill::raymill ALIAS raymill_package)

set(raymill_libraries "")
raymill_collect_libraries(raymill_package raymill_libraries)
install(TARGETS ${raymill_libraries} EXPORT RaymillTargets
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
        OBJECTS DESTINATION ${CMAKE_INSTALL_LIBDIR}/raymill)

set(raymill_package_directory ${CMAKE_INSTALL_LIBDIR}/cmake/Raymill)
install(EXPORT RaymillTargets NAMESPACE Raymill:: DESTINATION ${raymill_package_directory})
configure_package_config_file(
  ${CMAKE_CURRENT_LIST_DIR}/RaymillConfig.cmake.in ${PROJECT_BINARY_DIR}/package/RaymillConfig.cmake
  INSTALL_DESTINATION ${raymill_package_directory} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/package/RaymillConfigVersion.cmake
                                 COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/package/RaymillConfig.cmake ${PROJECT_BINARY_DIR}/package/RaymillConfigVersion.cmake
        DESTINATION ${raymill_package_directory})

# The programs. raymill starts raymill-image to write pictures and read textures, raymill-vdb to read OpenVDB files.
if(TARGET raymill)
  install(TARGETS raymill RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
foreach(image_program IN ITEMS raymill-image raymill_image raymill-vdb)
  if(TARGET ${image_program})
    install(TARGETS ${image_program} RUNTIME DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/raymill)
  endif()
endforeach()
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
