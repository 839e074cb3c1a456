// The one translation unit that holds the body of tinygltf: no images, no file system, no Draco.
#define TINYGLTF_IMPLEMENTATION
#include "storage/import/tinygltf_config.h"
