// tinygltf as Raymill uses it. Every file of ours includes this one and none includes tiny_gltf.h.
#pragma once

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#define TINYGLTF_NO_FS
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_USE_CPP14

#ifdef TINYGLTF_IMPLEMENTATION
#include <fstream>  // its writers, which stay unused, need it
#include <nlohmann/json.hpp>
#endif

#include <tiny_gltf.h>
