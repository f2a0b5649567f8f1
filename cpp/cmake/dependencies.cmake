# What a program links besides libsolidmap.a: sets solidmap_libraries and solidmap_link_options. With solidmap_native
# also what CGAL and TetGen need, which brings TetGen's licence, the AGPL; without it only system libraries.
set(THREADS_PREFER_PTHREAD_FLAG ON)
find_package(Threads REQUIRED)
set(solidmap_libraries Threads::Threads ${CMAKE_DL_LIBS})
if(UNIX AND NOT APPLE)
  list(APPEND solidmap_libraries m)
endif()
set(solidmap_link_options)
if(UNIX AND NOT APPLE)
  # In a shared library on ELF, the first call of a matrix kernel would go through the dynamic linker's lazy binding,
  # which does not preserve the registers that these kernels pass their arguments in: a crash. Calls that are bound
  # within the library, or at load time, do not go that way.
  set(is_shared "$<OR:$<STREQUAL:$<TARGET_PROPERTY:TYPE>,SHARED_LIBRARY>,$<STREQUAL:$<TARGET_PROPERTY:TYPE>,MODULE_LIBRARY>>")
  set(solidmap_link_options "$<${is_shared}:LINKER:-z,now,-Bsymbolic-functions>")
endif()
if(solidmap_native)
  # None of them has CMake files in Debian.
  foreach(library IN ITEMS tet mpfr gmp)
    find_library(SOLIDMAP_LIBRARY_${library} ${library})
    mark_as_advanced(SOLIDMAP_LIBRARY_${library})
    if(NOT SOLIDMAP_LIBRARY_${library})
      set(solidmap_missing "lib${library} was not found; install it with `apt-get install libtet1.5-dev libmpfr-dev \
libgmp-dev`, or build solidmap without CGAL and TetGen: -DSOLIDMAP_NATIVE=OFF")
      break()
    endif()
    list(APPEND solidmap_libraries "${SOLIDMAP_LIBRARY_${library}}")
  endforeach()
  if(solidmap_missing AND NOT CMAKE_FIND_PACKAGE_NAME STREQUAL "solidmap")
    message(FATAL_ERROR "${solidmap_missing}")
  endif()
endif()
