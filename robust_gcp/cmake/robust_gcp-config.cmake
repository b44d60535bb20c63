# find_package(robust_gcp): the C library of the installed Python package, as the target robust_gcp::robust_gcp.
# -Drobust_gcp_DIR="$(python -c 'import robust_gcp; print(robust_gcp.__path__[0] + "/cmake")')"
get_filename_component(_robust_gcp "${CMAKE_CURRENT_LIST_DIR}/.." ABSOLUTE)
find_file(robust_gcp_LIBRARY NAMES kernel.so kernel.dylib PATHS "${_robust_gcp}/kernel" NO_DEFAULT_PATH)
if(NOT robust_gcp_LIBRARY)
  set(robust_gcp_FOUND FALSE)
  set(robust_gcp_NOT_FOUND_MESSAGE "the package was installed without a compiled kernel")
  return()
endif()
if(NOT TARGET robust_gcp::robust_gcp)
  add_library(robust_gcp::robust_gcp SHARED IMPORTED)
  set_target_properties(robust_gcp::robust_gcp PROPERTIES
    IMPORTED_LOCATION "${robust_gcp_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${_robust_gcp}/include")
endif()
unset(_robust_gcp)
